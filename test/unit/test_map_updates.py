# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import numpy as np
import pytest
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Header

from smokebot_udp.streams.grid.map_updates import updated


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
