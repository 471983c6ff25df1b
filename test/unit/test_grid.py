# SPDX-License-Identifier: BSD-3-Clause
import math
import queue
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Pose
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from nav_msgs.msg import OccupancyGrid

from smokebot_udp.codecs.wire import interleave
from smokebot_udp.codecs.wire.grid import as_cells, fit, reduce_by, unknown
from smokebot_udp.codecs.wire.interleave import Interleave
from smokebot_udp.mission.parameters import check
from smokebot_udp.msg import GridSegment
from smokebot_udp.streams.base import Link
from smokebot_udp.streams.grid import GridReceiver, GridSender, begin, check_origin
from smokebot_udp.streams.rounds import QUIET
from smokebot_udp.udpros.datagram import OVERHEAD


def test_the_highest_of_each_block_and_unknown_only_where_all_is():
    cells = np.array([[-1, -1, 0, 5, 100], [-1, -1, -1, 3, -1], [0, -1, 1, 2, -1]], np.int8)
    assert reduce_by(cells, 2).tolist() == [[-1, 5, 100], [0, 2, -1]]
    assert reduce_by(cells, 1).tolist() == cells.tolist()
    assert reduce_by(cells, 9).tolist() == [[100]]


@given(arrays.arrays(np.int8, st.tuples(st.integers(1, 20), st.integers(1, 20)), elements=st.integers(-1, 100)),
       st.integers(1, 7))
def test_against_a_slow_loop(cells, factor):
    height, width = (-(-side // factor) for side in cells.shape)
    slow = [[cells[r * factor:(r + 1) * factor, c * factor:(c + 1) * factor].max() for c in range(width)]
            for r in range(height)]
    assert reduce_by(cells, factor).tolist() == slow


def segments_needed(height, width, factor, room):
    try:
        cut, per_segment = interleave.fit(-(-height // factor), -(-width // factor), 1, room)
    except ValueError:
        return math.inf
    return -(-len(cut) // per_segment)


@given(st.integers(1, 4096), st.integers(1, 4096), st.integers(1, 1400), st.integers(1, 1400),
       st.integers(1, 300) | st.integers(1, 65536))
@settings(deadline=None)
def test_the_least_factor_within_both_limits(height, width, room, max_cells, max_segments):
    factor, cut, per_segment = fit(height, width, room, max_cells, max_segments)
    rows, columns = cut.shape
    assert rows * columns * per_segment <= min(room, max_cells)
    assert (cut.height, cut.width) == (-(-height // factor), -(-width // factor))
    needed = [segments_needed(height, width, smaller, min(room, max_cells)) for smaller in range(1, factor + 1)]
    assert needed.pop() <= max_segments and all(count > max_segments for count in needed)


def test_cells_that_no_cut_fits_are_reduced_until_one_does():
    """4096 rows at the greatest depth are subimages of 16 cells, so one cell a segment takes 16 times fewer."""
    assert fit(4096, 16, 1350, 1, 65536) == (16, Interleave(256, 1, 8), 1)


def test_the_deliverables_numbers():
    assert fit(500, 500, 1350, 1300, 256)[0] == 1
    assert fit(4096, 4096, 1350, 1300, 256)[0] == 8


@pytest.mark.parametrize('arguments, words', [
    ((b'', 0, 5, 0.1), 'height is 0'), ((b'', 5, 5000, 0.1), 'width is 5000'),
    ((bytes(3), 2, 2, 0.1), 'data has 3 cells'),
    ((bytes(5), 2, 2, 0.1), 'data has 5 cells, height x width is 2 x 2 = 4'), ((bytes(4), -2, -2, 0.1), 'height is -2'),
    ((bytes(4), 2, 2, 0.0), 'resolution is 0.0'), ((bytes(4), 2, 2, float('nan')), 'resolution is nan'),
    ((bytes(4), 2, 2, -0.1), 'resolution is -0.1'), ((bytes(4), 2, 2, math.inf), 'resolution is inf')])
def test_what_is_wrong_is_named(arguments, words):
    data, *others = arguments
    with pytest.raises(ValueError, match=words):
        as_cells(np.frombuffer(data, np.int8), *others)


def test_what_never_came_is_unknown():
    cut = Interleave(2, 2, 1)
    filled = unknown(np.zeros((4, 1, 1), np.uint8), np.array([True, False, True, False]), cut)
    assert filled.view(np.int8).ravel().tolist() == [0, -1, 0, -1]


def grid_message(cells, stamp=5, resolution=0.05, frame_id='k\u00e9p'):
    cells = np.asarray(cells, np.int8)
    message = OccupancyGrid(data=cells.ravel())
    message.header.stamp.secs, message.header.stamp.nsecs, message.header.frame_id = stamp, 7, frame_id
    message.info.height, message.info.width = cells.shape
    message.info.resolution, message.info.map_load_time.secs = resolution, 3
    message.info.origin.position.x, message.info.origin.orientation.w = -12.5, 1.0
    return message


def some_cells(height=90, width=70, seed=0):
    return np.random.RandomState(seed).randint(-1, 101, (height, width)).astype(np.int8)


def sender(max_datagram_size=1472, **settings):
    """No ROS is needed to make frames: a stream is not started."""
    return GridSender('map', check({'robot_topic': '/map', **settings}, GridSender.PARAMETERS),
                      Link(max_datagram_size))


def segments_of(frames):
    return [GridSegment().deserialize(row[OVERHEAD:].tobytes()) for frame in frames for row in frame.rows]


@pytest.mark.parametrize('max_datagram_size', [200, 576, 1472])
def test_segments_fit_and_say_what_was_reduced(max_datagram_size):
    frames = sender(max_datagram_size, max_segments=3).frames(grid_message(some_cells()))
    assert 1 <= sum(map(len, frames)) <= 3
    assert all(frame.datagram_size <= max_datagram_size for frame in frames)
    for segment in segments_of(frames):
        info = segment.info
        factor = round(info.resolution / 0.05)
        assert factor > 1 and info.resolution == np.float32(0.05 * factor)
        assert (info.height, info.width) == (-(-90 // factor), -(-70 // factor))
        assert (info.origin.position.x, info.origin.orientation.w, info.map_load_time.secs) == (-12.5, 1.0, 3)
        assert (segment.header.frame_id, segment.header.stamp.to_nsec()) == ('k\u00e9p', 5 * 10 ** 9 + 7)


def test_the_largest_map_goes():
    frames = sender().frames(grid_message(np.zeros((4096, 4096), np.int8)))
    assert sum(map(len, frames)) <= 256 and max(frame.datagram_size for frame in frames) <= 1472


def test_the_same_map_only_gets_a_new_stamp():
    stream = sender()
    stream._send(grid_message(some_cells(), stamp=5))
    kept = stream._frames
    assert stream.frames(grid_message(some_cells(), stamp=8)) is None
    assert stream._frames is kept
    stream._publisher = SimpleNamespace(get_num_connections=lambda: 1)
    stream._send_round()
    assert {segment.header.stamp.secs for segment in segments_of(kept)} == {8}
    assert stream.link.outbox.sends('map', kept)
    stream.frames(grid_message(some_cells(), stamp=9))
    stream._send_round()       # what is leaving goes on as it is
    assert {segment.header.stamp.secs for segment in segments_of(kept)} == {8}


def one_wall_more(message):
    message.data = message.data.copy()
    message.data[33] = 100 if message.data[33] != 100 else 0


@pytest.mark.parametrize('change', [
    one_wall_more, lambda message: setattr(message.info.origin.position, 'y', 0.1),
    lambda message: setattr(message.info, 'resolution', 0.1),
    lambda message: setattr(message.header, 'frame_id', 'other')])
def test_a_changed_map_goes_at_once(change):
    stream, message = sender(), grid_message(some_cells())
    stream._send(message)
    change(message)
    assert stream.frames(message) is not None


def test_new_settings_cut_the_same_map_anew():
    stream = sender()
    stream._send(grid_message(some_cells()))
    stream.configure({'max_cells': 100})
    frames = stream.frames(grid_message(some_cells()))
    assert max(len(segment.data) for segment in segments_of(frames)) <= 100


@pytest.mark.parametrize('part, axis, value', [('position', 'y', math.nan), ('orientation', 'w', math.inf)])
def test_a_place_that_is_none(part, axis, value):
    origin = Pose()
    check_origin(origin)
    setattr(getattr(origin, part), axis, value)
    with pytest.raises(ValueError, match=r'%s is %r' % (axis, value)):
        check_origin(origin)


HEAD = {'resolution': 0.05, 'width': 5, 'height': 4, 'position': (0.0,) * 3, 'orientation': (0.0,) * 4, 'depth': 2}


@pytest.mark.parametrize('lie', [
    {'resolution': math.nan}, {'resolution': 0.0}, {'resolution': -1.0}, {'resolution': math.inf}, {'width': 0},
    {'height': 2 ** 32 - 1}, {'position': (0.0, math.nan, 0.0)}, {'orientation': (0.0, 0.0, 0.0, math.inf)},
    {'depth': 9}])
def test_impossible_maps_are_refused_on_arrival(lie):
    def head(resolution, width, height, position, orientation, depth):
        return SimpleNamespace(info=((0, 0), resolution, width, height, (position, orientation)), depth=depth)
    assert begin(head(**HEAD)).cut == Interleave(4, 5, 2)
    with pytest.raises(ValueError):
        begin(head(**{**HEAD, **lie}))


@pytest.fixture
def receiver():
    """One whose thread runs, but that receives and publishes nothing by ROS: `shown` has its messages."""
    stream = GridReceiver('map', check({'operator_topic': '/map', 'fill': 'unknown'}, GridReceiver.PARAMETERS),
                          Link(1472))
    stream.shown = queue.Queue()
    stream.publish = lambda message, stamp, completeness: stream.shown.put(message)
    stream.subscriber = stream._publisher = SimpleNamespace(unregister=lambda: None)
    stream._thread.start()
    yield stream
    stream.close()


def deliver(receiver, frames, of=lambda count: np.ones(count, bool)):
    for frame in frames:
        receiver.take(frame.records, of(len(frame)))


def test_the_map_comes_out_as_it_was_reduced(receiver):
    cells = some_cells(300, 200)
    deliver(receiver, sender(max_segments=20).frames(grid_message(cells)))
    message = receiver.shown.get(timeout=10)
    factor = round(message.info.resolution / 0.05)
    assert factor > 1 and message.info.resolution == np.float32(0.05 * factor)
    assert message.data.dtype == np.int8
    assert message.data.reshape(message.info.height, message.info.width).tolist() == reduce_by(cells, factor).tolist()
    assert (message.header.frame_id, message.header.stamp.to_nsec()) == ('k\u00e9p', 5 * 10 ** 9 + 7)
    assert message.info.origin == grid_message(cells).info.origin


def test_rounds_complete_the_map_and_the_same_is_shown_once(receiver):
    frames = sender(max_cells=100).frames(grid_message(some_cells()))
    deliver(receiver, frames, lambda count: np.arange(count) % 2 == 0)
    half = receiver.shown.get(timeout=10).data
    came = half != -1
    assert 0.4 < came.mean() < 0.6 and (half[came] == some_cells().ravel()[came]).all()
    deliver(receiver, frames, lambda count: np.arange(count) % 2 == 1)
    assert receiver.shown.get(timeout=10).data.tolist() == some_cells().ravel().tolist()
    deliver(receiver, frames)
    with pytest.raises(queue.Empty):
        receiver.shown.get(timeout=3 * QUIET)
    with receiver._changed:
        assert receiver._rounds.deadline is None    # it was looked at, and not shown
