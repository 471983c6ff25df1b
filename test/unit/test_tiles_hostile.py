# SPDX-License-Identifier: BSD-3-Clause
"""Forged datagrams of maps in tiles: bounded, counted, and nothing of them stays."""
import math
from typing import Any, Callable

import needs_numba  # noqa: F401
import numpy as np
import pytest
from test_tiles_assembler import Operator, operator_of, rooms
from tile_sender import TileSender, info_of

from smokebot_udp.codecs.tiles.rectangle import Rectangle
from smokebot_udp.streams.grid.canvas import MAX_REVISION
from smokebot_udp.streams.grid.identified_map import CANDIDATE_TIMEOUT, MAX_CANDIDATES
from smokebot_udp.streams.grid.tiled_map import LATENESS

CELLS = rooms()
INFO = info_of(CELLS, (-3.0, 2.0))
CORNER = Rectangle(-60, 40, 20, 20)


@pytest.fixture
def robot() -> TileSender:
    return TileSender()


@pytest.fixture
def operator(robot: TileSender) -> Operator:
    return operator_of(robot)


def lie(path: str, value: Any) -> Callable[[Any], None]:
    """Write into a nested field of a record."""
    def write(record: Any) -> None:
        *outer, last = path.split('.')
        for name in outer:
            record = record[name]
        record[last] = value
    return write


@pytest.mark.parametrize('spoil', [
    lie('info.resolution', math.nan), lie('info.resolution', 0.0), lie('info.resolution', math.inf),
    lie('info.resolution', -1.0), lie('info.resolution', 1e-30), lie('info.origin.position.x', math.nan),
    lie('info.origin.position.y', 1e300), lie('info.origin.orientation.w', math.inf),
    lie('info.origin.orientation.z', 1e308), lie('info.width', 0), lie('info.height', 4097),
    lie('info.width', (1 << 32) - 1), lie('corner', [1 << 30, (1 << 30) + 1]), lie('corner', [-(1 << 31), 0]),
    lie('place', [-61, 40]), lie('place', [(1 << 31) - 1, 40]), lie('size', [0, 5]), lie('size', [65535, 65535]),
    lie('size', [0, 0]), lie('shift', 13), lie('shift', 255), lie('shift', 3), lie('revision', 0),
    lie('revision', (1 << 32) - 1),
])
def test_impossible_datagrams_are_refused(robot: TileSender, operator: Operator, spoil: Any) -> None:
    for _ in range(5):
        record = robot.cells(robot.revision + 1, CORNER, 7)
        spoil(record)
        operator.receive([record])
    assert operator.show() is None
    assert operator.assembler.dropped['impossible head'] == 5


@pytest.mark.parametrize('data', [b'', b'\x01\x02', b'\xff', b'\x66', b'\x66' + bytes(range(100, 250))])
def test_broken_tiles_change_nothing(robot: TileSender, operator: Operator, data: bytes) -> None:
    operator.receive([robot.tile(robot.revision + 1, CORNER, data),
                      robot.tile(robot.revision + 1, Rectangle(-30, 20, 10, 10), data, shift=1)])
    assert operator.show() is None
    assert (operator.assembler.dropped['tile'], operator.assembler.dropped['overview']) == (1, 1)


@pytest.mark.parametrize('other', ['session', 'frame', 'lattice', 'rectangle'])
def test_two_forged_datagrams_begin_no_map_however_often(robot: TileSender, operator: Operator, other: str) -> None:
    forger = TileSender(session=6 if other == 'session' else robot.session)
    cells = np.full((30, 40) if other == 'rectangle' else CELLS.shape, 100, np.int8)
    origin = (-3.02, 2.0) if other == 'lattice' else (-3.0, 2.0)
    forged = forger.update(cells, info_of(cells, origin), 'level2' if other == 'frame' else 'map')[0]
    for _ in range(10):
        operator.receive([forged, forged, forged, forger.beat(), robot.beat()])
    assert operator.show() is None
    assert operator.assembler.holding().session == robot.session
    assert operator.assembler.dropped['unproven'] == 40


def test_forged_maps_do_not_keep_a_true_one_from_beginning(operator: Operator) -> None:
    new = TileSender(session=9)
    cells = rooms(seed=3)
    tiles = new.update(cells, INFO)
    for number, tile in enumerate(tiles):
        forger = TileSender(session=1000 + number)
        forger.update(CELLS, INFO)
        operator.receive([tile, *(forger.beat() for _ in range(2))])
    operator.show()
    assert operator.assembler.holding().session == 9
    np.testing.assert_array_equal(operator.cells, cells)


def test_proofs_are_few_and_expire(operator: Operator) -> None:
    for session in range(6, 6 + 3 * MAX_CANDIDATES):
        forger = TileSender(session)
        forger.update(CELLS, INFO)
        operator.receive([forger.beat()])
    assert operator.assembler.dropped['unproven'] == 2 * MAX_CANDIDATES
    operator.receive([forger.beat()])
    operator.receive([forger.beat()], after=CANDIDATE_TIMEOUT + 1)
    assert operator.assembler.dropped['unproven'] == 3 * MAX_CANDIDATES + 1
    assert operator.assembler.holding().session == 5


@pytest.mark.parametrize('revision', ['same', 'newer', 'highest'])
def test_a_forged_tile_does_not_stay(robot: TileSender, operator: Operator, revision: str) -> None:
    tiles = robot.all_tiles()
    victim = max(tiles, key=lambda tile: tile['data'].shape[1])
    place = Rectangle(*victim['place'][0].tolist(), *victim['size'][0].tolist())
    number = int(victim['revision'][0])
    forged = {'same': number, 'newer': robot.revision + 5, 'highest': MAX_REVISION}[revision]
    operator.receive([robot.cells(forged, place, 33)])
    operator.show()
    if revision != 'same':
        assert (operator.cells == 33).sum() == place.width * place.height
    assert number not in operator.held()        # so the robot repeats it
    operator.receive([victim], after=0.1)
    operator.receive([victim], after=LATENESS)
    operator.show()
    np.testing.assert_array_equal(operator.cells, CELLS)
    assert number in operator.held()


def test_forged_overviews_give_way_to_the_robots_statements(robot: TileSender, operator: Operator) -> None:
    data = bytes([101])     # 100 everywhere
    operator.receive([robot.tile(MAX_REVISION, Rectangle(-30, 20, 65, 45), data, shift=1)])
    operator.show()
    assert (operator.cells == 100).mean() > 0.6
    operator.receive([robot.beat()], after=2.0)
    operator.show()
    np.testing.assert_array_equal(operator.cells, CELLS)


@pytest.mark.parametrize('pending', [
    [[-(1 << 31), -(1 << 31), (1 << 31) - 1, (1 << 31) - 1]] * 80, [[-60, 40, -5, -5]], [[5, 5, 0, 0]],
    [[(1 << 31) - 1] * 4]])
def test_impossible_rectangles_are_nowhere(robot: TileSender, operator: Operator, pending: Any) -> None:
    operator.receive([robot.beat([Rectangle(*rectangle) for rectangle in pending])], after=9.0)
    assert set(operator.assembler.ages(operator.now).data.tolist()) == {0}


def test_rectangles_in_part_are_refused_by_their_number(robot: TileSender, operator: Operator) -> None:
    record = robot.beat([Rectangle(-60, 40, 130, 90)])
    odd = np.zeros(1, np.dtype([(name, record.dtype[name] if name != 'pending' else ('<i4', 3))
                                for name in record.dtype.names]))
    for name in record.dtype.names:
        if name != 'pending':
            odd[name] = record[name]
    operator.receive([odd])
    assert operator.assembler.dropped['impossible head'] == 1


def test_interleaved_segments_begin_no_map_beside_tiles(robot: TileSender, operator: Operator) -> None:
    from test_grid_assembler import segments

    def receive_interleaved() -> None:
        for record in segments(np.full((40, 50), 100, np.int8)):
            operator.assembler.receive(record, np.ones(len(record), bool), operator.now)
    receive_interleaved()
    for _ in range(5):
        operator.receive([robot.beat()], after=1.0)
        assert operator.show(0.0) is None
    operator.now += 0.1
    receive_interleaved()
    assert operator.show(2.8) is None
    assert operator.show(0.2) is not None       # the robot sends no tiles any more
    assert operator.cells.shape == (40, 50)
    operator.receive([robot.beat()])
    operator.show()
    np.testing.assert_array_equal(operator.cells, CELLS)
