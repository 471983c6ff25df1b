# SPDX-License-Identifier: BSD-3-Clause
"""Maps in tiles on the operator's side, from the datagrams that a robot sends."""
import collections
from typing import Any, Iterable, List, Optional

import needs_numba  # noqa: F401
import numpy as np
import pytest
from tile_sender import TileSender, info_of

from evaluation.offline_link import operator_side, work_off
from smokebot_udp.codecs.tiles.rectangle import Rectangle
from smokebot_udp.streams.grid.assembler import GridAssembler
from smokebot_udp.streams.grid.tiles_assembler import BURST, MAX_WAITING, TilesAssembler, decode
from smokebot_udp.streams.held import Holding
from smokebot_udp.streams.segments import TILES

RATE = 5.0


def rooms(height: int = 90, width: int = 130, seed: int = 0, noise: float = 0.01) -> Any:
    """Unknown outside, walls, and some noise."""
    random = np.random.RandomState(seed)
    cells = np.full((height, width), -1, np.int8)
    cells[5:-5, 5:-5] = 0
    cells[10:-5:25, 5:-5] = cells[5:-5, 10:-5:30] = 100
    cells[random.random_sample(cells.shape) < noise] = 100
    return cells


class Operator:
    """An assembler with a clock."""

    def __init__(self, **settings: Any) -> None:
        self.assembler, self.settings = operator_side('grid', rate=RATE, **settings)
        assert isinstance(self.assembler, GridAssembler)
        self.now = 100.0
        self.shown: Any = None

    def receive(self, records: Iterable[Any], after: float = 0.0) -> None:
        self.now += after
        for record in records:
            self.assembler.receive(record, np.ones(len(record), bool), self.now, TILES)
            work_off(self.assembler)

    def show(self, after: float = 1.0) -> Optional[Any]:
        """The map that is published until then, if any is."""
        self.now += after
        finished = self.assembler.poll(self.now)
        assembled = finished and self.assembler.assemble(finished, self.settings, False, self.now)
        if assembled is not None:
            self.shown = assembled
        return assembled

    @property
    def cells(self) -> Any:
        info = self.shown.message.info
        return self.shown.message.data.reshape(info.height, info.width)

    def held(self) -> List[int]:
        holding = self.assembler.holding()
        assert holding is not None
        return [number for first, count in holding.runs for number in range(first, first + count)]


def operator_of(robot: TileSender) -> Operator:
    """One that has the whole map of a robot."""
    made = Operator()
    made.receive(robot.update(rooms(), info_of(rooms(), (-3.0, 2.0))))
    assert made.show() is not None
    np.testing.assert_array_equal(made.cells, rooms())
    return made


@pytest.fixture
def robot() -> TileSender:
    return TileSender()


@pytest.fixture
def operator(robot: TileSender) -> Operator:
    return operator_of(robot)


def test_the_map_is_exact(robot: TileSender, operator: Operator) -> None:
    np.testing.assert_array_equal(operator.cells, rooms())
    message = operator.shown.message
    assert operator.shown.completeness == 1.0
    assert message.info == robot.source.info
    assert (message.header.frame_id, message.header.stamp.secs) == ('map', 1)
    assert operator.held() == list(range(1, robot.revision + 1))
    assert operator.assembler.holding().session == robot.session
    assert operator.assembler.deadline() is None


def test_a_map_in_part_is_the_overview_and_the_tiles_received(robot: TileSender) -> None:
    cells, operator = rooms(), Operator()
    tiles = robot.update(cells, info_of(cells))
    operator.receive(robot.overview() + tiles[::2])
    operator.show()
    assert 0.2 < operator.shown.completeness < 0.8
    assert (operator.cells >= np.where(operator.cells == cells, -1, cells)).all()
    assert (operator.cells >= cells).all()      # no obstacle is lost
    operator.receive(tiles[1::2])
    operator.show()
    np.testing.assert_array_equal(operator.cells, cells)


def test_three_different_datagrams_begin_a_map(robot: TileSender) -> None:
    operator = Operator()
    tiles = robot.update(rooms(), info_of(rooms()))
    assert operator.assembler.holding() is None
    operator.receive([tiles[0], tiles[1], tiles[1], tiles[0]])
    assert operator.show() is None
    assert operator.assembler.holding() == Holding(robot.session, ())      # asks for all
    operator.receive([robot.beat()])
    assert operator.show() is not None
    assert operator.held() == [1, 2]    # nothing was lost by it


def test_changes_are_shown_soon_and_not_more_often_than_rate(robot: TileSender, operator: Operator) -> None:
    cells = rooms()
    operator.now += 1.0
    operator.receive(robot.update(np.roll(cells, 1), info_of(cells, (-3.0, 2.0))))
    assert operator.show(BURST) is not None
    for change in range(1, 4):
        cells[20:40, 30:50] = change
        changed = robot.update(cells, info_of(cells, (-3.0, 2.0)))
        operator.receive(changed)
        assert operator.show(BURST / 2) is None
        assert operator.show(BURST) is None
        assert operator.show(1 / RATE - BURST) is not None
        np.testing.assert_array_equal(operator.cells, cells)
    operator.receive(robot.all_tiles())
    assert operator.assembler.deadline() is None
    assert operator.assembler.dropped['not needed'] == len(robot.all_tiles())


def test_late_tiles_change_nothing(robot: TileSender, operator: Operator) -> None:
    old = robot.all_tiles()
    cells = np.where(rooms() == 0, 40, rooms()).astype(np.int8)
    operator.receive(robot.update(cells, info_of(cells, (-3.0, 2.0))))
    operator.show()
    operator.receive(old)
    assert operator.show() is None
    dropped = operator.assembler.dropped
    assert dropped['late'] > 5 and dropped['late'] + dropped['not needed'] == len(old)


def test_a_growing_map_whose_origin_moves_keeps_its_tiles(robot: TileSender, operator: Operator) -> None:
    held = set(operator.held())
    cells = np.full((140, 200), -1, np.int8)
    cells[20:110, 40:170] = rooms()
    info = info_of(cells, (-3.0 - 40 * 0.05, 2.0 - 20 * 0.05))
    tiles = robot.update(cells, info, stamp=9.0)
    operator.receive([robot.beat(), *robot.overview(), *tiles[:1]])
    operator.show()
    assert operator.shown.message.info == info and operator.shown.message.header.stamp.secs == 9
    np.testing.assert_array_equal(operator.cells[20:110, 40:170], rooms())
    assert len(held & set(operator.held())) > 0
    operator.receive(tiles[1:])
    operator.show()
    np.testing.assert_array_equal(operator.cells, cells)
    assert len(tiles) < len(robot.all_tiles())


def test_a_map_that_shrinks(robot: TileSender, operator: Operator) -> None:
    cells = rooms()[30:, :64]
    tiles = robot.update(cells, info_of(cells, (-3.0, 2.0 + 30 * 0.05)))
    operator.receive(tiles + [robot.beat() for _ in range(3)])
    operator.show()
    np.testing.assert_array_equal(operator.cells, cells)


def test_a_rectangle_that_changes_without_any_cells_is_shown(robot: TileSender, operator: Operator) -> None:
    cells = rooms()[:, :64]
    robot.update(cells, info_of(cells, (-3.0, 2.0)))
    operator.receive([robot.beat() for _ in range(3)])      # the tiles that are new are lost
    operator.show()
    np.testing.assert_array_equal(operator.cells, cells)


def test_a_robot_that_starts_again_replaces_its_map_tile_by_tile(operator: Operator) -> None:
    cells, again = rooms(seed=1), TileSender(session=6)
    tiles = again.update(cells, info_of(cells, (-3.0, 2.0)))
    operator.receive(tiles[:3])
    operator.show()
    assert operator.assembler.holding().session == 6 and operator.held() == [1, 2, 3]
    assert operator.shown.completeness == 1.0
    assert ((operator.cells == rooms()) | (operator.cells == cells)).all()
    operator.receive(tiles[3:])
    operator.show()
    np.testing.assert_array_equal(operator.cells, cells)


@pytest.mark.parametrize('place', ['frame', 'resolution', 'turned'])
def test_another_map_begins_empty_and_the_old_one_is_shown_until_then(
        robot: TileSender, operator: Operator, place: str) -> None:
    cells, other = rooms(40, 50), TileSender(session=6)
    info = info_of(cells, (-3.0, 2.0), 0.1 if place == 'resolution' else 0.05)
    info.origin.orientation.z = 0.1 if place == 'turned' else 0.0
    tiles = other.update(cells, info, 'level2' if place == 'frame' else 'map')
    operator.receive(robot.update(1 - rooms(noise=1.0) // 100, info_of(rooms(), (-3.0, 2.0))))   # not shown yet
    operator.receive([other.beat() for _ in range(3)])
    assert operator.show() is None      # nothing is known of it
    operator.receive(tiles)
    operator.show()
    np.testing.assert_array_equal(operator.cells, cells)


def test_a_map_that_moves_by_a_part_of_a_cell_is_shown_there_with_all_its_cells(
        robot: TileSender, operator: Operator) -> None:
    held = operator.held()
    for step in range(1, 6):
        robot.move(info_of(rooms(), (-3.0 + 0.37 * 0.05 * step, 2.0 - 0.01 * step)))
        operator.receive([robot.beat() for _ in range(3)])
        operator.show()
        np.testing.assert_array_equal(operator.cells, rooms())
        assert operator.shown.message.info == robot.source.info and operator.shown.completeness == 1.0
        assert operator.held() == held
        assert operator.assembler.ages(operator.now).data.max() == 0


def test_a_slash_before_its_frame_makes_no_other_map(robot: TileSender, operator: Operator) -> None:
    changed = rooms()
    changed[50, 60] = 100 - changed[50, 60]
    tile, = robot.update(changed, info_of(rooms(), (-3.0, 2.0)), '/map')
    operator.receive([tile])        # no proof is needed
    operator.show()
    np.testing.assert_array_equal(operator.cells, changed)
    assert operator.shown.message.header.frame_id == '/map'


@pytest.mark.parametrize('columns, rows', [(0, 0), (7, -20), (-16, 32)])
def test_a_robot_that_starts_again_and_numbers_its_map_otherwise(operator: Operator, columns: int, rows: int) -> None:
    info = info_of(rooms(), (-3.0 + 0.05 * (columns + 0.3), 2.0 + 0.05 * (rows + 0.3)))
    again, cells = TileSender(session=6), np.roll(rooms(), (-rows, -columns), (0, 1))
    tiles = again.update(cells, info)
    operator.receive([again.beat() for _ in range(3)])
    operator.show()
    seen = np.s_[max(0, -rows):rooms().shape[0] - max(0, rows), max(0, -columns):rooms().shape[1] - max(0, columns)]
    np.testing.assert_array_equal(operator.cells[seen], cells[seen])
    assert operator.cells.size - (operator.cells == -1).sum() < operator.cells.size
    assert operator.held() == [] and operator.assembler.holding().session == 6
    operator.receive(tiles)
    operator.show()
    np.testing.assert_array_equal(operator.cells, cells)
    assert set(operator.assembler.ages(operator.now).data.tolist()) == {0}


def test_the_overview_shows_a_new_obstacle_before_its_tile_comes() -> None:
    robot, operator, cells = TileSender(room=20), Operator(), rooms(noise=0.0)
    operator.receive(robot.update(cells, info_of(cells, (-3.0, 2.0))))
    cells[64:80, 76:90] = 100
    lost = robot.update(cells, info_of(cells, (-3.0, 2.0)))
    operator.receive(robot.overview())
    operator.show()
    assert (operator.cells[64:80, 76:90] == 100).all()
    operator.receive([robot.beat([Rectangle(-60, 40, 130, 90)])], after=2.0)     # all of it is pending
    assert operator.show() is None
    operator.receive(lost)
    operator.show()
    np.testing.assert_array_equal(operator.cells, cells)


def test_ages_grow_unless_the_robot_confirms(robot: TileSender, operator: Operator) -> None:
    def ages() -> List[int]:
        return sorted(set(operator.assembler.ages(operator.now).data.tolist()))
    assert ages() == [0]        # less than 3 s
    operator.now += 10
    assert ages() == [11]
    operator.receive([robot.beat()])
    assert ages() == [0]
    operator.receive([robot.beat([Rectangle(-60, 40, 20, 20)])], after=3.0)
    assert ages() == [0, 3]
    operator.now += 1000
    assert ages() == [100]


def test_before_a_map_there_are_no_ages() -> None:
    assert Operator().assembler.ages(5.0) is None


def test_an_interleaved_map_is_shown_until_something_of_tiles_is_known(robot: TileSender) -> None:
    from test_grid_assembler import segments, some_cells
    operator = Operator()
    for record in segments(some_cells(40, 50)):
        operator.assembler.receive(record, np.ones(len(record), bool), operator.now)
    operator.show()
    np.testing.assert_array_equal(operator.cells, some_cells(40, 50))
    assert set(operator.assembler.ages(operator.now + 20).data.tolist()) == {21}
    tiles = robot.update(rooms(), info_of(rooms()))
    operator.receive([robot.beat() for _ in range(3)])
    assert operator.show() is None
    operator.receive(tiles)
    operator.show()
    np.testing.assert_array_equal(operator.cells, rooms())


def test_an_interleaved_map_from_before_the_tiles_does_not_replace_them(robot: TileSender) -> None:
    from test_grid_assembler import segments, some_cells
    operator = Operator()
    for record in segments(some_cells(40, 50)):
        operator.assembler.receive(record, np.ones(len(record), bool), operator.now)
    operator.receive(robot.update(rooms(), info_of(rooms())), after=0.01)
    operator.show()
    np.testing.assert_array_equal(operator.cells, rooms())
    assert operator.show(60.0) is None      # the link is gone
    assert operator.assembler.deadline() is None


# what takes time is done elsewhere

class Decoder:
    """Counts what is decoded."""

    def __init__(self) -> None:
        self.sizes: List[int] = []

    def __call__(self, data: Any, height: int, width: int) -> Any:
        self.sizes.append(height * width)
        return decode(data, height, width)


class Tiles:
    """The assembler of tiles alone."""

    def __init__(self) -> None:
        self.decoder, self.dropped = Decoder(), collections.Counter()   # type: Decoder, Counter[str]
        self.assembler = TilesAssembler(RATE, self.dropped, self.decoder)

    def receive(self, records: Iterable[Any], now: float = 100.0) -> None:
        for record in records:
            self.assembler.receive(record, np.ones(len(record), bool), now)

    def shown(self, now: float) -> Any:
        found = self.assembler.poll(now)
        return None if found is None else found.drawn()[0]


def test_nothing_is_decoded_where_segments_are_received(robot: TileSender) -> None:
    tiles, cells = Tiles(), np.zeros((512, 512), np.int8)
    cells[7, 9] = 100
    sent = robot.update(cells, info_of(cells))
    assert len(sent) == 1 and sent[0]['data'].size < 60
    tiles.receive([*sent, robot.beat(), robot.beat()])
    assert tiles.decoder.sizes == [] and tiles.assembler.waiting and tiles.shown(200.0) is None
    work = tiles.assembler.work()
    assert work is not None and tiles.decoder.sizes == []
    work.do()
    assert tiles.decoder.sizes == [512 * 512] and tiles.assembler.holding() == Holding(robot.session, ())
    work.done()
    assert tiles.assembler.holding() == Holding(robot.session, ((1, 1),))
    assert (tiles.shown(200.0) == cells).all()


def test_copies_that_come_together_are_decoded_once(robot: TileSender) -> None:
    tiles = Tiles()
    sent = robot.update(rooms(), info_of(rooms()))
    tiles.receive([*sent, *sent])
    work_off(tiles.assembler)
    assert len(tiles.decoder.sizes) == len(sent) == tiles.dropped['not needed']


def test_segments_are_sorted_in_their_order_although_the_map_moves_meanwhile(robot: TileSender) -> None:
    tiles, now = Tiles(), 100.0
    tiles.receive(robot.update(rooms(), info_of(rooms(), (-3.0, 2.0))), now)
    moved = np.roll(rooms(), -5, 1)
    tiles.receive(robot.update(moved, info_of(moved, (-2.75, 2.0))), now)
    other = TileSender(session=8)
    last = rooms(seed=4)
    tiles.receive(other.update(last, info_of(last, (-2.75, 2.0))), now)
    tiles.receive([other.beat()], now + 2.0)
    work_off(tiles.assembler)
    assert (tiles.shown(now + 3.0) == last).all() and tiles.assembler.holding().session == 8    # type: ignore[union-attr]
    assert not {'tile', 'late', 'contradiction', 'impossible head'} & set(tiles.dropped)


def test_more_segments_than_can_wait_are_dropped_and_counted(robot: TileSender) -> None:
    tiles = Tiles()
    robot.update(rooms(), info_of(rooms()))
    beat = robot.beat()
    tiles.receive([beat] * (MAX_WAITING + 7))
    assert tiles.dropped == {'too many': 7}
