# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of maps in tiles, as the runner uses it, with a model of the operator's side."""
from types import SimpleNamespace
from typing import Any, Dict, List, Optional

import needs_numba  # noqa: F401
import numpy as np
import pytest
from map_msgs.msg import OccupancyGridUpdate
from map_receiver import MapReceiver, segments_of
from test_grid_encoder import grid_message, settings

from evaluation.linked_encoder import LinkedEncoder
from smokebot_udp.codecs.tiles import coder
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import GridSegment, MapTile
from smokebot_udp.streams.grid.encoder import FALLBACK, WAIT, GridEncoder
from smokebot_udp.streams.grid.tiles_encoder import TICK
from smokebot_udp.streams.held import Holding


def building(height: int = 300, width: int = 400, seed: int = 0) -> Any:
    """Rooms with walls, furniture and unknown surroundings."""
    cells, chance = np.full((height, width), -1, np.int8), np.random.RandomState(seed)
    cells[10:-10, 10:-10] = np.where(chance.rand(height - 20, width - 20) < 0.01, 100, 0)
    cells[10:-10:40, 10:-10] = cells[10:-10, 10:-10:60] = 100
    return cells


def at_zero(cells: Any) -> Any:
    """A map whose first corner is the origin of its frame."""
    message = grid_message(cells)
    message.info.origin.position.x = message.info.origin.position.y = 0.0
    return message


class Robot:
    """An encoder with a clock and operators."""

    def __init__(self, ready: bool = True, lookup: Any = lambda *_: None, **changes: Any) -> None:
        self.now, self.parts = 100.0, {'tiles': ['/op'], 'segments': ['/op']}   # type: float, Dict[str, List[str]]
        self.settings = settings(coding='tiles', **changes)
        self.codec = SimpleNamespace(ready=lambda: ready)
        numbers = iter(range(7, 100))
        self.encoder = LinkedEncoder(
            GridEncoder(self.settings.requested, self.codec, lambda: self.now, lookup, lambda: next(numbers)),
            operators=lambda part: self.parts[part],
            heard=lambda part: bool(self.parts[part]) and set(self.parts[part]) >= {
                name for names in self.parts.values() for name in names})
        self.set_loss(0.0)

    def set_loss(self, loss: float) -> None:
        self.encoder.see(outlook=SimpleNamespace(loss=lambda probability: loss))

    def take(self, cells: Any, **changes: Any) -> Any:
        return self.encoder.encode(grid_message(cells, **changes), self.settings, 1472)

    def wait(self, seconds: float, receivers: Optional[Dict[str, MapReceiver]] = None) -> List[Any]:
        """What it sends in this time; receivers get all, and report."""
        left, until = [], self.now + seconds
        while True:
            period = self.encoder.repeat_period(self.settings)
            assert period is not None
            if self.now + period > until:
                self.now = until
                return left
            self.now += period
            segments = segments_of(self.encoder.repeat(self.settings, 1472))
            left += segments
            for name, receiver in (receivers or {}).items():
                for segment in segments:
                    receiver.receive(segment)
                if segments:
                    self.encoder.held(name, receiver.holding() or Holding(0, ()))


def served(cells: Any, **changes: Any) -> Any:
    """A robot whose operator holds the map, and the operator's receiver."""
    robot, receiver = Robot(**changes), MapReceiver()
    for segment in segments_of(robot.take(cells)):
        receiver.receive(segment)
    robot.wait(3.0, {'/op': receiver})
    assert (receiver.map == cells).all()
    return robot, receiver


def test_the_map_is_lossless_and_the_overview_comes_first() -> None:
    cells = building(700, 900)
    robot, receiver = served(cells)
    assert receiver.complete and receiver.overviews and receiver.tiles
    first = receiver.overviews[0]
    values = coder.decode(np.frombuffer(first.data, np.uint8), first.size[1], first.size[0])
    block = 1 << first.shift
    corner = first.corner
    assert corner == (-250, 0)
    for row in range(first.size[1]):
        for column in range(first.size[0]):
            left, low = ((first.place[0] + column) * block - corner[0], (first.place[1] + row) * block - corner[1])
            part = cells[max(low, 0):low + block, max(left, 0):left + block]
            assert values[row, column] == part.max()
    order = segments_of(Robot().take(cells))
    assert [bool(one.size[0]) for one in order[:2]] == [False, True] and order[1].shift > 0


def test_a_still_map_that_is_held_costs_a_beat_a_second() -> None:
    robot, receiver = served(building())
    left = robot.wait(20.0, {'/op': receiver})
    assert 19 <= len(left) <= 21 and all(one.size == (0, 0) and one.current and not one.pending for one in left)
    assert {one.revision for one in left} == {max(one.revision for one in receiver.tiles)}
    robot.take(building(), stamp=77)
    assert {one.header.stamp.secs for one in robot.wait(2.0, {'/op': receiver})} == {77}


def test_a_small_change_leaves_at_once_and_alone() -> None:
    robot, receiver = served(building())
    cells = building()
    cells[100:120, 200:220] = 100
    frames = robot.take(cells)
    patch, = (one for one in segments_of(frames) if one.size[0])
    assert patch.size[0] <= 20 and sum(frame.datagram_size + 28 for frame in frames) < 700
    receiver.receive(patch)
    assert (receiver.map == cells).all()


def test_the_same_lattice_keeps_the_session_and_another_one_begins_anew() -> None:
    robot, receiver = served(building())
    assert receiver.session == 7
    grown = np.full((340, 430), -1, np.int8)
    grown[20:320, 10:410] = building()
    message = grid_message(grown)
    message.info.origin.position.x, message.info.origin.position.y = -12.5 - 0.5, -1.0
    for segment in segments_of(robot.encoder.encode(message, robot.settings, 1472)):
        receiver.receive(segment)
    robot.wait(2.0, {'/op': receiver})
    assert receiver.session == 7 and (receiver.map == grown).all()
    assert {one.session for one in segments_of(robot.take(building(), resolution=0.1))} == {8}


def test_without_operators_nothing_leaves_and_a_newcomer_gets_the_overview_at_once() -> None:
    robot = Robot()
    robot.parts = {'tiles': [], 'segments': []}
    assert robot.take(building(700, 900)) == []
    robot.parts = {'tiles': ['/op'], 'segments': ['/op']}
    order = segments_of(robot.encoder.repeat(robot.settings, 1472))
    assert [one.size[0] > 0 and one.shift > 0 for one in order[:2]] == [False, True]


def test_a_second_operator_gets_everything_and_the_first_one_nothing_new() -> None:
    robot, first = served(building())
    late = MapReceiver()
    robot.parts = {'tiles': ['/op', '/late'], 'segments': ['/op', '/late']}
    left = robot.wait(3.0, {'/op': first, '/late': late})
    assert (late.map == building()).all()
    tiles = [one.revision for one in left if one.size[0] and not one.shift]
    assert sorted(tiles) == sorted({one.revision for one in first.tiles})


@pytest.mark.parametrize('silence', [1.0, 60.0], ids=['heard lately', 'silent'])
def test_an_operator_that_is_replaced_by_one_of_its_name_gets_the_map_at_once(silence: float) -> None:
    robot, _ = served(building())
    robot.wait(silence)
    robot.encoder.joined()      # it reports nothing, as nothing has arrived
    left = [one for _ in range(4) for one in segments_of(robot.encoder.repeat(robot.settings, 1472))
            + robot.wait(0.25)]
    tiles = [one.revision for one in left if one.size[0] and not one.shift]
    assert all(tiles.count(revision) >= 3 for revision in set(tiles)) and len(set(tiles)) > 1


def test_an_operator_without_tiles_makes_it_interleaved_for_all_but_not_while_it_subscribes() -> None:
    robot = Robot()
    robot.parts['segments'] = ['/op', '/old']
    assert robot.take(building()) == []
    assert robot.encoder.repeat_period(robot.settings) <= FALLBACK
    robot.now += FALLBACK
    frames = robot.encoder.repeat(robot.settings, 1472)
    assert {frame.message_class for frame in frames} == {GridSegment}
    robot.parts['segments'] = ['/op']
    frames = robot.encoder.repeat(robot.settings, 1472)
    assert {frame.message_class for frame in frames} == {MapTile}


def test_until_the_codec_is_ready_maps_are_interleaved() -> None:
    robot = Robot(ready=False)
    assert {frame.message_class for frame in robot.take(building())} == {GridSegment}
    robot.codec.ready = lambda: True
    assert {frame.message_class for frame in robot.encoder.repeat(robot.settings, 1472)} == {MapTile}


def test_a_report_does_not_keep_the_thread_busy() -> None:
    robot, receiver = served(building())
    robot.encoder.held('/op', receiver.holding() or Holding(0, ()))
    assert robot.encoder.repeat_period(robot.settings) == TICK     # repeat is not called while the last frames leave


@pytest.mark.parametrize('stopped', [{'granted': None}, {'requested': {'enabled': False}}])
def test_while_nothing_may_be_sent_a_change_waits(stopped: Any) -> None:
    robot, receiver = served(building())
    running, cells = robot.settings, building()
    robot.settings = Settings({**running.requested, **stopped.get('requested', {})}, stopped.get('granted', {}))
    cells[100:120, 200:220] = 100
    assert robot.take(cells) == []
    robot.encoder.held('/op', Holding(7, ()))
    period = robot.encoder.repeat_period(robot.settings)
    assert period == WAIT     # although a report waits
    robot.settings = running
    patch = next(one for one in segments_of(robot.encoder.repeat(running, 1472)) if one.size[0])
    assert patch.size[0] <= 20


def test_the_pace_is_obeyed_whatever_operators_report() -> None:
    robot = Robot(max_bitrate=200.0)
    robot.take(building(900, 1200))
    sizes, until = [], robot.now + 10.0
    while robot.now < until:
        robot.now += 0.02
        for lie in (Holding(7, ()), Holding(8, ((1, 9),)), Holding(7, ((1, 65535),))):
            robot.encoder.held('/op', lie)
            sizes += [frame.datagram_size + 28 for frame in robot.encoder.repeat(robot.settings, 1472)]
    assert sum(sizes) <= 200e3 / 8 * 10.2 + 4 * 1500


def test_the_pace_is_obeyed_while_the_map_moves_all_the_time() -> None:
    robot, cells, left = Robot(max_bitrate=16.0), building(), []
    for step in range(100):
        frames = robot.take(cells[:, :200 + step]) if step % 2 else robot.take(cells[:, :200])
        for _ in range(10):
            robot.now += 0.02
            frames = [*frames, *robot.encoder.repeat(robot.settings, 1472)]
        left += frames
    assert sum(frame.datagram_size + 28 for frame in left) <= 16e3 / 8 * 20 + 2 * 1500


def test_demands_follow_what_operators_lack() -> None:
    robot = Robot()
    assert robot.encoder.operating_points(1.0, robot.settings) == []
    robot.take(building(900, 1200))
    points = robot.encoder.operating_points(1.0, robot.settings)
    assert points[-1].settings == {'max_bitrate': 1000.0} and points[-1].cost > 20000
    assert points[0].settings['max_bitrate'] < 20
    held = served(building())[0]
    held.wait(20.0)
    still = held.encoder.operating_points(1.0, held.settings)
    assert len(still) == len(points) and still[-1].cost < 1000
    assert held.encoder.refine({'max_bitrate': 8.0}, 1000.0) == {'max_bitrate': 16.0}
    assert held.encoder.refine({'max_bitrate': 8.0}, 1e9) == {'max_bitrate': 1000.0}


def test_what_is_near_the_robot_leaves_first() -> None:
    asked = []

    def lookup(frame: str, header: Any) -> Any:
        asked.append((frame, header.frame_id))
        return np.eye(3, dtype=np.float32), np.array([-12.5 + 0.05 * 850, 0.05 * 650, 0.0], np.float32)
    order = segments_of(Robot(lookup=lookup).take(building(700, 900)))
    assert asked == [('k\u00e9p', 'base_link')]
    first = next(one for one in order if one.size[0] and not one.shift)
    assert (0 <= 850 - 250 - first.place[0] < first.size[0]) and (0 <= 650 - first.place[1] < first.size[1])
    Robot(lookup=lookup, robot_frame='').take(building())
    assert len(asked) == 1


def test_updates_change_the_newest_map() -> None:
    robot, receiver = served(building())
    cells = building()
    message = robot.encoder.merge(None, grid_message(cells))
    cells[5:7, 6:9] = 42
    update = OccupancyGridUpdate(x=6, y=5, width=3, height=2, data=[42] * 6)
    update.header.frame_id = 'k\u00e9p'
    for segment in segments_of(robot.encoder.encode(robot.encoder.merge(message, update), robot.settings, 1472)):
        receiver.receive(segment)
    assert (receiver.map == cells).all()
    assert GridEncoder(robot.settings.requested).merge(None, update) is None
    assert list(robot.encoder.sources(robot.settings.requested)) == ['/map_updates']


def test_smaller_datagrams_cut_the_map_anew() -> None:
    robot, _ = served(building())
    frames = robot.encoder.repeat(robot.settings, 500)
    assert frames and max(frame.datagram_size for frame in frames) <= 500


@pytest.mark.parametrize('value', [-2, 101])
def test_values_that_no_occupancy_grid_has(value: int) -> None:
    cells = building()
    cells[3, 4] = value
    with pytest.raises(ValueError, match='data has the value %d, must be from -1 to 100' % value):
        Robot().take(cells)
    assert Robot(ready=False).encoder.encode(grid_message(cells), settings(), 1472)


def test_a_map_of_another_size_is_proven_at_once() -> None:
    robot, _ = served(np.zeros((20, 20), np.int8))
    grown = segments_of(robot.take(np.zeros((20, 21), np.int8))) + robot.wait(0.2)
    assert len([one for one in grown if one.info.width == 21]) >= 3


def test_the_overview_of_a_map_that_only_shrank_lies_inside_it() -> None:
    cells = np.where(np.random.RandomState(1).rand(512, 1024) < 0.1, 100, 0).astype(np.int8)
    robot = Robot()
    robot.encoder.encode(at_zero(cells), robot.settings, 1472)
    robot.parts = {'tiles': [], 'segments': []}
    robot.encoder.encode(at_zero(cells[:, :512]), robot.settings, 1472)
    robot.parts = {'tiles': ['/late'], 'segments': ['/late']}
    robot.now += 1.0
    overviews = [one for one in segments_of(robot.encoder.repeat(robot.settings, 1472)) if one.shift]
    assert overviews and all(one.place[0] + one.size[0] <= 512 >> one.shift for one in overviews)


def test_at_the_lowest_bitrate_statements_leave_room_for_tiles() -> None:
    cells = np.where(np.random.RandomState(1).rand(600, 600) < 0.1, 100, 0).astype(np.int8)
    robot, receiver = Robot(max_bitrate=8.0), MapReceiver()
    for segment in segments_of(robot.take(cells)):
        receiver.receive(segment)
    begun = robot.now
    left = robot.wait(60.0, {'/op': receiver})
    tiles = sum(len(one.data) for one in left if one.size[0] and not one.shift)
    assert tiles > 0.2 * 1000 * (robot.now - begun)


# one bad message does not spoil what is kept

def update_of(row: int, column: int, values: Any) -> Any:
    cells = np.asarray(values, np.int8)
    update = OccupancyGridUpdate(x=column, y=row, width=cells.shape[1], height=cells.shape[0], data=cells.ravel())
    update.header.frame_id = 'k\u00e9p'
    return update


class Costmap:
    """Publishes a map and updates of it; an operator watches."""

    def __init__(self) -> None:
        self.robot, self.receiver = served(building())
        self.cells = building()
        self.robot.encoder.merge(None, grid_message(self.cells.copy()))

    def publish(self, message: Any) -> None:
        frames = self.robot.encoder.encode(self.robot.encoder.merge(None, message), self.robot.settings, 1472)
        for segment in segments_of(frames):
            self.receiver.receive(segment)
        self.robot.wait(1.0, {'/op': self.receiver})

    def update(self, row: int, column: int, value: int) -> None:
        self.cells[row:row + 10, column:column + 10] = value
        self.publish(update_of(row, column, np.full((10, 10), value)))

    def shows(self, cells: Any) -> bool:
        return bool((self.receiver.map == cells).all())


@pytest.mark.parametrize('value', [101, -2])
def test_an_update_with_a_value_that_is_none_is_refused_and_the_next_ones_are_shown(value: int) -> None:
    costmap, wrong = Costmap(), np.full((10, 10), 50)
    wrong[3, 4] = value
    with pytest.raises(ValueError, match='data has the value %d, must be from -1 to 100' % value):
        costmap.publish(update_of(20, 30, wrong))
    for step in range(5):
        costmap.update(100 + 10 * step, 40, 20 + step)
        assert costmap.shows(costmap.cells)


@pytest.mark.parametrize('value', [101, -2])
def test_updates_go_on_after_a_map_with_a_value_that_is_none(value: int) -> None:
    costmap = Costmap()
    costmap.cells = building(seed=3)
    costmap.cells[3, 4] = value
    with pytest.raises(ValueError, match='data has the value %d, must be from -1 to 100' % value):
        costmap.publish(grid_message(costmap.cells.copy()))
    costmap.cells[3, 4] = -1
    costmap.update(100, 40, 20)
    assert costmap.shows(costmap.cells)


def cut_off(message: Any) -> None:
    message.data = message.data[:-1]


def nowhere(message: Any) -> None:
    message.info.origin.position.y = float('nan')


def far_away(message: Any) -> None:
    message.info.origin.position.x = 1e12


@pytest.mark.parametrize('spoil, words', [(cut_off, 'data has'), (nowhere, 'origin.y is nan'),
                                          (far_away, 'cells away')])
def test_a_map_that_contradicts_itself_changes_nothing(spoil: Any, words: str) -> None:
    costmap = Costmap()
    for _ in range(2):
        wrong = grid_message(building(seed=3))
        spoil(wrong)
        with pytest.raises(ValueError, match=words):
            costmap.publish(wrong)
        assert costmap.shows(costmap.cells)
        if spoil is cut_off:
            costmap.update(100, 40, 20)     # of a map in this very place
            assert costmap.shows(costmap.cells)
    costmap.publish(grid_message(costmap.cells.copy()))
    costmap.update(100, 60, 30)
    assert costmap.shows(costmap.cells)


def test_updates_of_a_refused_map_in_another_place_are_not_drawn_into_the_old_one() -> None:
    costmap = Costmap()
    wrong = grid_message(building(310, 400))
    cut_off(wrong)
    with pytest.raises(ValueError, match='data has'):
        costmap.publish(wrong)
    assert costmap.robot.encoder.merge(None, update_of(0, 0, [[7]])) is None


def test_interleaved_maps_may_have_any_values() -> None:
    of = settings(coding='interleaved')
    encoder, cells = LinkedEncoder(GridEncoder(of.requested)), building()
    cells[3, 4] = 101
    encoder.merge(None, grid_message(cells))
    merged = encoder.merge(None, update_of(0, 0, [[-5]]))
    assert (merged.data[0], merged.data.reshape(cells.shape)[3, 4]) == (-5, 101)
