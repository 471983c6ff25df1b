# SPDX-License-Identifier: BSD-3-Clause
import io
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Header

from smokebot_udp.streams.grid.map_updates import BLOCK, changed_rectangles, same_place, update_of, updated


def grid() -> Any:
    message = OccupancyGrid(header=Header(frame_id='map'), data=[0] * 6)
    message.info.height, message.info.width = 2, 3
    return message


def update(x: int = 1, y: int = 0, width: int = 2, height: int = 1, data: Any = (7, 8), frame_id: str = 'map') -> Any:
    message = OccupancyGridUpdate(header=Header(frame_id=frame_id), x=x, y=y, width=width, height=height, data=data)
    message.header.stamp.secs = 9
    return message


def test_an_update_by_hand() -> None:
    before = grid()
    after = updated(before, update())
    assert np.asarray(after.data).tolist() == [0, 7, 8, 0, 0, 0] and after.header.stamp.secs == 9
    assert before.data == [0] * 6 and before.header.stamp.secs == 0
    assert np.asarray(updated(after, update(0, 1, 1, 1, [100])).data).tolist() == [0, 7, 8, 100, 0, 0]


@pytest.mark.parametrize('wrong, words', [
    (update(x=2), 'at column 2, row 0 of a map of 3 x 2'), (update(x=-1), 'at column -1'),
    (update(height=3), 'of 2 x 3 cells at'), (update(data=[1]), 'of 2 x 1 cells with 1 values'),
    (update(frame_id='odom'), "in frame 'odom' of a map in frame 'map'"), (update(width=2 ** 31, x=0), 'at column 0')])
def test_updates_that_are_not_of_the_map(wrong: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        updated(grid(), wrong)


def test_an_update_of_a_map_that_contradicts_itself() -> None:
    before = grid()
    before.data = [0] * 5
    with pytest.raises(ValueError, match='3 x 2 cells with 5 values'):
        updated(before, update())


# changes, for those who read updates

@pytest.mark.parametrize('cells, expected', [
    ([], []), ([(3, 5)], [(5, 3, 1, 1)]), ([(3, 5), (10, 2)], [(2, 3, 4, 8)]),
    ([(0, 0), (199, 299)], [(0, 0, 1, 1), (299, 199, 1, 1)]),
    ([(63, 63), (64, 64)], [(63, 63, 2, 2)]),                       # neighbouring blocks
    ([(3, 5), (3, 200), (190, 5)], [(5, 3, 1, 1), (200, 3, 1, 1), (5, 190, 1, 1)])])
def test_the_rectangles_that_changed(cells: Any, expected: Any) -> None:
    before, after = np.zeros((200, 300), np.int8), np.zeros((200, 300), np.int8)
    for row, column in cells:
        after[row, column] = 100
    assert changed_rectangles(before, after) == expected


def test_many_changes_are_one_rectangle() -> None:
    before, after = np.zeros((1000, 1000), np.int8), np.zeros((1000, 1000), np.int8)
    after[10::2 * BLOCK, 20::2 * BLOCK] = 1
    assert changed_rectangles(before, after) == [(20, 10, 7 * 2 * BLOCK + 1, 7 * 2 * BLOCK + 1)]


MAPS = st.tuples(st.integers(1, 150), st.integers(1, 150), st.lists(st.tuples(st.integers(0, 149), st.integers(0, 149)),
                                                                    max_size=30))


@given(MAPS)
def test_a_reader_of_updates_has_the_map(case: Any) -> None:
    height, width, changes = case
    before, after = grid(), grid()
    for message in before, after:
        message.info.height, message.info.width = height, width
    cells = np.zeros((2, height, width), np.int8)
    for row, column in changes:
        cells[1, row % height, column % width] += 1
    before.data, after.data = cells[0].reshape(-1), cells[1].reshape(-1)
    seen = before
    for part in changed_rectangles(cells[0], cells[1]):
        crossed = OccupancyGridUpdate()
        written = io.BytesIO()
        update_of(after, part).serialize(written)
        crossed.deserialize(written.getvalue())
        seen = updated(seen, crossed)
    assert np.asarray(seen.data).tolist() == after.data.tolist()


def test_the_same_place() -> None:
    before, later = grid(), grid()
    later.info.map_load_time.secs, later.data = 7, [1] * 6
    assert same_place(before, later)
    for change in ({'width': 2}, {'height': 3}, {'resolution': 0.5}):
        other = grid()
        for name, value in change.items():
            setattr(other.info, name, value)
        assert not same_place(before, other)
    other = grid()
    other.info.origin.position.x = 1.0
    assert not same_place(before, other)
    other = grid()
    other.header.frame_id = 'odom'
    assert not same_place(before, other)
