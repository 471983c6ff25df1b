# SPDX-License-Identifier: BSD-3-Clause
"""Maps on the operator's side, and both sides of a stream: an encoder's datagrams to an assembler's message."""
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid

from evaluation.offline_link import Sender, assemble_all, operator_side
from smokebot_udp.codecs.wire.grid import reduce_by
from smokebot_udp.codecs.wire.interleave import Interleave
from smokebot_udp.streams.carousel import QUIET
from smokebot_udp.streams.grid.assembler import GridAssembler

HEAD = {'resolution': 0.05, 'width': 5, 'height': 4, 'position': (0.0,) * 3, 'orientation': (0.0,) * 4, 'depth': 2}


def grid_message(cells: Any) -> OccupancyGrid:
    message = OccupancyGrid(data=cells.ravel())
    message.header.stamp.secs, message.header.stamp.nsecs, message.header.frame_id = 5, 7, 'k\u00e9p'
    message.info.height, message.info.width = cells.shape
    message.info.resolution, message.info.map_load_time.secs = 0.05, 3
    message.info.origin.position.x, message.info.origin.orientation.w = -12.5, 1.0
    return message


def some_cells(height: int = 90, width: int = 70) -> Any:
    return np.random.RandomState(0).randint(-1, 101, (height, width)).astype(np.int8)


def segments(cells: Any, **settings: Any) -> Any:
    """[records of a frame, ...]"""
    return [frame.records for frame in Sender('grid', coding='interleaved', **settings).frames(grid_message(cells))]


@pytest.mark.parametrize('lie', [
    {'resolution': math.nan}, {'resolution': 0.0}, {'resolution': -1.0}, {'resolution': math.inf}, {'width': 0},
    {'height': 2 ** 32 - 1}, {'position': (0.0, math.nan, 0.0)}, {'orientation': (0.0, 0.0, 0.0, math.inf)},
    {'depth': 9}])
def test_impossible_maps_are_refused_on_arrival(lie: Any) -> None:
    def head(resolution: float, width: int, height: int, position: Any, orientation: Any, depth: int) -> Any:
        return SimpleNamespace(info=((0, 0), resolution, width, height, (position, orientation)), depth=depth)
    assert GridAssembler.begin(head(**HEAD)).cut == Interleave(4, 5, 2)     # type: ignore[arg-type]
    with pytest.raises(ValueError):
        GridAssembler.begin(head(**{**HEAD, **lie}))


def test_the_map_comes_out_as_it_was_reduced() -> None:
    cells = some_cells(300, 200)
    assembled, = assemble_all(*operator_side('grid', fill='unknown'), segments(cells, max_segments=20))
    message = assembled.message
    factor = round(message.info.resolution / 0.05)
    assert factor > 1 and message.info.resolution == np.float32(0.05 * factor)
    assert message.data.dtype == np.int8
    assert message.data.reshape(message.info.height, message.info.width).tolist() == reduce_by(cells, factor).tolist()
    assert (message.header.frame_id, message.header.stamp.to_nsec()) == ('k\u00e9p', 5 * 10 ** 9 + 7)
    assert message.info.origin == grid_message(cells).info.origin and message.info.map_load_time.secs == 3
    assert (assembled.stamp, assembled.completeness) == (5 * 10 ** 9 + 7, 1.0)


def test_cycles_complete_the_map_and_the_same_is_published_once() -> None:
    assembler, values = operator_side('grid', fill='unknown')
    records = segments(some_cells(), max_cells=100)
    first, = assemble_all(assembler, values, [part[::2] for part in records], now=1.0)
    half = first.message.data
    came = half != -1
    assert 0.4 < came.mean() < 0.6 and (half[came] == some_cells().ravel()[came]).all()
    assert first.completeness == pytest.approx(came.mean(), abs=0.05)
    second, = assemble_all(assembler, values, [part[1::2] for part in records if len(part) > 1], now=2.0)
    assert second.message.data.tolist() == some_cells().ravel().tolist()
    assert assemble_all(assembler, values, records, now=3.0) == []
    assert assembler.deadline() is None


@pytest.mark.parametrize('columns, kept', [(0.37, True), (-0.9, True), (1.2, False)])
def test_a_map_that_moves_by_a_part_of_a_cell_keeps_what_came_of_it(columns: float, kept: bool) -> None:
    assembler, values = operator_side('grid', fill='unknown')
    parts = segments(some_cells(), max_cells=100)
    assemble_all(assembler, values, [part[::2] for part in parts], now=1.0)
    moved = grid_message(some_cells())
    moved.info.origin.position.x += 0.05 * columns
    moved.header.stamp.secs += 1
    parts = [frame.records for frame in Sender('grid', coding='interleaved', max_cells=100).frames(moved)]
    shown, = assemble_all(assembler, values, [part[1::2] for part in parts], now=2.0)
    assert shown.message.info.origin == moved.info.origin
    assert (shown.completeness == 1.0) == kept
    assert (shown.message.data == some_cells().ravel()).all() == kept


def test_a_slash_before_its_frame_makes_no_other_map() -> None:
    assembler, values = operator_side('grid', fill='unknown')
    again = grid_message(some_cells())
    again.header.frame_id = '/' + again.header.frame_id
    parts = segments(some_cells(), max_cells=100)
    assemble_all(assembler, values, [part[::2] for part in parts], now=1.0)
    parts = [frame.records for frame in Sender('grid', coding='interleaved', max_cells=100).frames(again)]
    shown, = assemble_all(assembler, values, [part[1::2] for part in parts], now=2.0)
    assert (shown.message.header.frame_id, shown.completeness) == (again.header.frame_id, 1.0)


def test_settings_apply_to_the_map_that_is_there() -> None:
    assembler, values = operator_side('grid', fill='unknown')
    part = segments(some_cells(), max_cells=100)[0][::2]
    assembler.receive(part, np.ones(len(part), bool), 1.0)
    assembler.configure({**values, 'fill': 'nearest', 'max_wait': QUIET / 2}, {})     # type: ignore[arg-type]
    assert assembler.deadline() == pytest.approx(1.0 + QUIET / 2)
    snapshot = assembler.poll(2.0)
    assert snapshot is not None
    assembled = assembler.assemble(snapshot, values, False, 2.0)
    assert assembled is not None and assembled.message.data.min() >= -1 and assembled.completeness < 0.6
    assert (assembled.message.data == -1).mean() < 0.1      # those that were sent so
