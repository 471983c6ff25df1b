# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any, Callable, List, Optional

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid

from evaluation.linked_encoder import LinkedEncoder
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import GridSegment
from smokebot_udp.streams.grid.encoder import GridEncoder
from smokebot_udp.udpros.datagram import OVERHEAD
from smokebot_udp.udpros.endpoints import IP_UDP_HEADERS


def grid_message(cells: Any, stamp: int = 5, resolution: float = 0.05, frame_id: str = 'k\u00e9p') -> Any:
    cells = np.asarray(cells, np.int8)
    message = OccupancyGrid(data=cells.ravel())
    message.header.stamp.secs, message.header.stamp.nsecs, message.header.frame_id = stamp, 7, frame_id
    message.info.height, message.info.width = cells.shape
    message.info.resolution, message.info.map_load_time.secs = resolution, 3
    message.info.origin.position.x, message.info.origin.orientation.w = -12.5, 1.0
    return message


def some_cells(height: int = 90, width: int = 70, seed: int = 0) -> Any:
    return np.random.RandomState(seed).randint(-1, 101, (height, width)).astype(np.int8)


def settings(granted: Optional[dict] = None, **changes: Any) -> Settings:
    values = check({'robot_topic': '/map', 'coding': 'interleaved', **changes}, GridEncoder.PARAMETERS)
    return Settings(values, granted or {})


def encoded(message: Any, size: int = 1472, **changes: Any) -> List[Any]:
    of = settings(**changes)
    return LinkedEncoder(GridEncoder(of.requested)).encode(message, of, size)


def segments_of(frames: Any) -> List[Any]:
    return [GridSegment().deserialize(row[OVERHEAD:].tobytes()) for frame in frames for row in frame.rows]


@pytest.mark.parametrize('max_datagram_size', [200, 576, 1472])
def test_segments_fit_and_say_what_was_reduced(max_datagram_size: int) -> None:
    frames = encoded(grid_message(some_cells()), max_datagram_size, max_segments=3)
    assert 1 <= sum(map(len, frames)) <= 3
    assert all(frame.datagram_size <= max_datagram_size for frame in frames)
    for segment in segments_of(frames):
        info = segment.info
        factor = round(info.resolution / 0.05)
        assert factor > 1 and info.resolution == np.float32(0.05 * factor)
        assert (info.height, info.width) == (-(-90 // factor), -(-70 // factor))
        assert (info.origin.position.x, info.origin.orientation.w, info.map_load_time.secs) == (-12.5, 1.0, 3)
        assert (segment.header.frame_id, segment.header.stamp.to_nsec()) == ('k\u00e9p', 5 * 10 ** 9 + 7)


def test_a_small_map_by_hand() -> None:
    segment, = segments_of(encoded(grid_message([[-1, 0], [50, 100]])))
    assert (segment.depth, segment.index, segment.count) == (0, 0, 1)
    assert list(segment.data) == [-1, 0, 50, 100]


def test_the_largest_map_goes() -> None:
    frames = encoded(grid_message(np.zeros((4096, 4096), np.int8)))
    assert sum(map(len, frames)) <= 256 and max(frame.datagram_size for frame in frames) <= 1472


def test_the_same_map_only_gets_a_new_stamp() -> None:
    encoder, of = LinkedEncoder(GridEncoder(settings().requested)), settings()
    assert not encoder.repeat(of, 1472)
    frames = encoder.encode(grid_message(some_cells(), stamp=5), of, 1472)
    assert encoder.encode(grid_message(some_cells(), stamp=8), of, 1472) == []
    assert {segment.header.stamp.secs for segment in segments_of(frames)} == {5}    # they may still be leaving
    repeated = encoder.repeat(of, 1472)
    assert {segment.header.stamp.secs for segment in segments_of(repeated)} == {8}
    assert [segment.data for segment in segments_of(repeated)] == [segment.data for segment in segments_of(frames)]


def one_wall_more(message: Any) -> None:
    message.data = message.data.copy()
    message.data[33] = 100 if message.data[33] != 100 else 0


@pytest.mark.parametrize('change', [
    one_wall_more, lambda message: setattr(message.info.origin.position, 'y', 0.1),
    lambda message: setattr(message.info, 'resolution', 0.1),
    lambda message: setattr(message.header, 'frame_id', 'other')])
def test_a_changed_map_goes_at_once(change: Callable[[Any], None]) -> None:
    encoder, of, message = LinkedEncoder(GridEncoder(settings().requested)), settings(), grid_message(some_cells())
    before = encoder.encode(message, of, 1472)
    kept = [frame.rows.copy() for frame in before]
    change(message)
    frames = encoder.encode(message, of, 1472)
    assert frames and list(encoder.repeat(of, 1472)) == frames
    assert all((frame.rows == rows).all() for frame, rows in zip(before, kept))


def test_new_settings_cut_the_same_map_anew() -> None:
    encoder, message = LinkedEncoder(GridEncoder(settings().requested)), grid_message(some_cells())
    encoder.encode(message, settings(), 1472)
    frames = encoder.encode(message, settings({'max_cells': 100}), 1472)
    assert frames and max(len(segment.data) for segment in segments_of(frames)) <= 100
    assert encoder.encode(message, settings({'max_cells': 100, 'repeat_rate': 0.1}), 1472) == []


@pytest.mark.parametrize('part, axis, value', [('position', 'y', math.nan), ('orientation', 'w', math.inf)])
def test_a_place_that_is_none(part: str, axis: str, value: float) -> None:
    message = grid_message(some_cells())
    setattr(getattr(message.info.origin, part), axis, value)
    with pytest.raises(ValueError, match=r'origin.%s is %r' % (axis, value)):
        encoded(message)


def test_what_is_wrong_leaves_the_map_before_as_it_is() -> None:
    encoder, of = LinkedEncoder(GridEncoder(settings().requested)), settings()
    wrong = grid_message(some_cells(), stamp=9)
    frames = encoder.encode(grid_message(some_cells()), of, 1472)
    wrong.info.resolution = math.nan
    with pytest.raises(ValueError, match='resolution is nan'):
        encoder.encode(wrong, of, 1472)
    assert list(encoder.repeat(of, 1472)) == frames
    assert {segment.header.stamp.secs for segment in segments_of(frames)} == {5}


def test_an_unchanged_map_is_repeated_at_the_granted_rate() -> None:
    encoder = LinkedEncoder(GridEncoder(settings().requested))
    encoder.encode(grid_message(some_cells()), settings(), 1472)
    assert encoder.repeat_period(settings()) == 5.0
    assert encoder.repeat_period(settings({'repeat_rate': 0.05})) == 20.0


def test_operating_points_are_of_the_requested_map() -> None:
    granted = settings({'max_segments': 8, 'repeat_rate': 0.02})
    encoder = LinkedEncoder(GridEncoder(granted.requested))
    assert encoder.operating_points(10.0, granted) == []
    encoder.encode(grid_message(some_cells(300, 200)), granted, 1472)
    best = encoder.operating_points(10.0, granted)[-1]
    frames = encoded(grid_message(some_cells(300, 200)))
    count = sum(map(len, frames))
    assert best.settings == {'repeat_rate': 0.2, 'max_segments': count} and count > 8
    assert best.cost == pytest.approx(0.2 * count * (frames[0].datagram_size + IP_UDP_HEADERS), rel=0.1)
