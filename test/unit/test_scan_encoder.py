# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any, Dict, List, Sequence, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import LaserScan

from evaluation.linked_encoder import LinkedEncoder
from smokebot_udp.codecs.wire.scan import FIXED, ScanParts, in_millimetres
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import ScanSegment
from smokebot_udp.streams.scan.encoder import ScanEncoder, corrected
from smokebot_udp.streams.segments import size_on_air
from smokebot_udp.udpros.datagram import OVERHEAD


def encoded(message: Any, intensity: bool = False, size: int = 1472, **settings_: Any) -> List[Any]:
    settings = Settings(check({'robot_topic': '/scan', 'intensity': intensity, 'exact': True, **settings_},
                              ScanEncoder.PARAMETERS))
    return LinkedEncoder(ScanEncoder(settings.requested)).encode(message, settings, size)


def laser_scan(count: int = 720, **changes: Any) -> Any:
    message = LaserScan(angle_min=-math.pi, angle_max=math.pi, angle_increment=0.01, range_max=30.0,
                        ranges=np.random.RandomState(0).rand(count), intensities=[])
    message.header.frame_id = 'laser'
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def scanner(count: int = 720) -> Any:
    """A scan as drivers publish it: whole millimetres, intensities of a byte."""
    random = np.random.RandomState(1)
    message = laser_scan(ranges=in_millimetres(random.randint(50, 30000, count)), angle_min=-1.5, angle_increment=0.25,
                         time_increment=0.125, intensities=random.randint(0, 256, count).astype(np.float32))
    message.header.stamp.secs, message.header.stamp.nsecs, message.header.frame_id = 5, 7, 'k\u00e9p'
    message.angle_max = message.angle_min + (count - 1) * message.angle_increment
    return message


def shown(frames: List[Any], lost: Sequence[int] = ()) -> Tuple[Any, Any]:
    """The ranges and intensities that an operator shows."""
    record = frames[0].records[0]
    gathered = ScanParts(*(int(record[name]) for name in ('total', 'parts', 'range_size', 'intensity_size', 'step')))
    for frame in frames:
        assert frame.datagram_size <= 1472
        some = frame.records[~np.isin(frame.records['part'], lost)]
        assert gathered.add(some['part'].astype(int), some['ranges'], some['intensities']).all()
    return gathered.merge('nan')[:2]


@pytest.mark.parametrize('count', [1, 2, 3, 681, 720, 1081, 20001])
def test_segments_fit_and_make_the_scan_again(count: int) -> None:
    message = laser_scan(count, intensities=list(range(count)))
    frames = encoded(message, intensity=True)
    ranges, intensities = shown(frames)
    np.testing.assert_array_equal(ranges, np.float32(message.ranges))
    np.testing.assert_array_equal(intensities, np.float32(message.intensities))


INCREMENT = {'angle_min': -1.0, 'angle_max': 6.19, 'angle_increment': 0.01}
"""Angles of a scan of 720 ranges."""


@pytest.mark.parametrize('changes, words', [
    ({'angle_min': math.nan, 'angle_max': math.nan}, 'angle_min is nan'),
    ({'angle_min': math.inf, 'angle_increment': 0.0}, 'angle_increment is 0'),
    ({'angle_increment': 0.0, 'angle_max': math.nan}, 'angle_increment is 0'),
    ({'angle_increment': math.nan, 'angle_max': -1.0}, 'angle_increment is nan'),
    ({'angle_min': math.nan, 'angle_max': 0.5, 'angle_increment': math.nan}, 'angle_increment is nan'),
    ({'ranges': [1.0], 'angle_min': math.nan, 'angle_max': math.inf}, 'angle_min is nan')])
def test_a_scan_whose_place_is_not_known_is_refused(changes: Dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        encoded(laser_scan(**{**INCREMENT, **changes}))


@pytest.mark.parametrize('changes, field, sent', [
    *(({field: value}, field, wanted) for field, wanted in INCREMENT.items()
      for value in (math.nan, math.inf, -math.inf)),
    ({'angle_increment': 0.0}, 'angle_increment', 0.01), ({'angle_max': 0.0}, 'angle_max', 6.19),
    *(({field: value}, field, 0.0) for field in ('time_increment', 'scan_time', 'range_min')
      for value in (math.nan, math.inf, -math.inf)),
    ({'range_max': math.nan}, 'range_max', math.inf), ({'range_max': -math.inf}, 'range_max', math.inf)])
def test_a_field_that_the_ranges_contradict_is_told_and_follows_from_them(changes: Dict[str, Any], field: str,
                                                                          sent: float) -> None:
    message = laser_scan(**{**INCREMENT, **changes})
    settings = Settings(check({'robot_topic': '/scan'}, ScanEncoder.PARAMETERS))
    encoder = LinkedEncoder(ScanEncoder(settings.requested))
    records = encoder.encode(message, settings, 1472)[0].records
    assert float(records[field][0]) == pytest.approx(sent, rel=1e-6)
    assert [float(records[name][0]) for name in INCREMENT if name != field] == pytest.approx(
        [value for name, value in INCREMENT.items() if name != field], rel=1e-6)
    warning, = encoder.warnings
    assert warning.startswith('%s is %r' % (field, changes[field]))
    assert getattr(message, field) is changes[field]    # others have the same message


@pytest.mark.parametrize('changes', [
    {}, {'angle_max': 6.2}, {'angle_max': 6.18}, {'angle_max': 6.19 - 2 * math.pi}, {'range_max': math.inf},
    {'angle_min': 1.0, 'angle_increment': -0.01, 'angle_max': -6.19},
    {'ranges': [1.0], 'angle_increment': 0.0, 'angle_max': 5.0}, {'ranges': []}])
def test_what_drivers_do_is_no_contradiction(changes: Dict[str, Any]) -> None:
    message = laser_scan(**{**INCREMENT, **changes})
    assert corrected(message) == (message, [])


@pytest.mark.parametrize('count', [0, 1])
def test_of_a_single_ray_the_increment_says_nothing(count: int) -> None:
    for increment in math.nan, math.inf:
        sent, problems = corrected(laser_scan(count, **{**INCREMENT, 'angle_increment': increment}))
        assert (sent.angle_min, sent.angle_max, sent.angle_increment) == (-1.0, 6.19, 0.0) and len(problems) == 1


def test_intensities_of_another_number_are_left_out_and_told() -> None:
    message = laser_scan(intensities=[1.0], **INCREMENT)
    sent, problems = corrected(message)
    assert problems == ['it has 1 intensities, but 720 ranges: no intensity is sent'] and message.intensities == [1.0]
    assert not encoded(message, intensity=True)[0].records['intensity_size'].any()


def test_a_scan_without_ranges_is_sent() -> None:
    frame, = encoded(laser_scan(0, **INCREMENT), intensity=True)
    assert len(frame) == 1 and frame.records['total'].tolist() == [0] and frame.records['ranges'].size == 0


def test_a_scanners_scan_takes_two_datagrams() -> None:
    message = scanner()
    for with_intensity, size in (False, 0), (True, 1):
        frames = encoded(message, with_intensity)
        rows = [row for frame in frames for row in frame.rows]
        assert all(len(row) <= 1472 for row in rows)
        for part, row in enumerate(rows):
            segment = ScanSegment().deserialize(row[OVERHEAD:].tobytes())
            assert (segment.total, segment.parts, segment.part) == (720, 2, part)
            assert (segment.range_size, segment.intensity_size) == (2, size)
            assert [getattr(segment, field) for field in FIXED] == [np.float32(getattr(message, field))
                                                                   for field in FIXED]
            assert (segment.header.frame_id, segment.header.stamp.to_nsec()) == ('k\u00e9p', 5 * 10 ** 9 + 7)
            assert np.frombuffer(segment.ranges, '<u2').tolist() == np.rint(message.ranges[part::2] * 1000).tolist()
            assert len(segment.intensities) == 360 * size
        assert part == 1


def test_nor_does_the_sign_of_a_nan_make_it_longer() -> None:
    message = scanner(1081)
    message.ranges[::7] = np.uint32(0xffc00000).view(np.float32)
    assert [len(frame) for frame in encoded(message)] == [1, 1] == [len(frame) for frame in encoded(scanner(1081))]


@given(st.integers(1, 300), st.integers(100, 1472))
def test_no_datagram_is_too_long(count: int, max_datagram_size: int) -> None:
    frames = encoded(laser_scan(count), size=max_datagram_size)
    assert max(frame.datagram_size for frame in frames) <= max_datagram_size
    parts = [part for frame in frames for part in frame.records['part'].tolist()]
    assert parts == list(range(frames[0].records['parts'][0]))


def test_a_slow_link_gets_fewer_scans() -> None:
    settings = Settings(check({'robot_topic': '/scan'}, ScanEncoder.PARAMETERS))
    encoder = LinkedEncoder(ScanEncoder(settings.requested))
    assert encoder.operating_points(10.0, settings) == []
    size = size_on_air(encoder.encode(scanner(), settings, 1472))
    points = encoder.operating_points(10.0, settings)
    assert points[0].settings == {'rate': 1.0} and points[-1].settings == {'rate': 10.0}
    assert [point.cost for point in points] == [pytest.approx(point.settings['rate'] * size) for point in points]
    assert encoder.refine(points[0].settings, 1e9) == {'rate': 1.0}


def room_scan(noise: float, seed: int) -> Any:
    """1081 ranges in a room with boxes, as a Hokuyo UTM-30LX measures them, with some that see nothing."""
    random = np.random.RandomState(seed)
    angles = np.deg2rad(np.linspace(-135, 135, 1081))
    with np.errstate(divide='ignore'):
        ranges = np.min([side / np.maximum(np.cos(angles - toward), 1e-9) for side, toward in
                         ((4.0, 0.0), (3.0, 1.6), (6.0, 3.1), (2.5, -1.5))], axis=0)
    for begin in random.randint(0, 1000, 12):
        ranges[begin:begin + 40] *= random.uniform(0.3, 0.9)
    ranges = ranges + random.normal(0, noise, 1081)
    ranges[500:540] = np.inf
    return laser_scan(ranges=ranges.astype(np.float32), angle_min=-2.3, angle_increment=0.004363, range_max=30.0)


@pytest.mark.parametrize('noise', [0.003, 0.01, 0.02])
def test_an_indoor_scan_takes_a_third(noise: float) -> None:
    """Also the datasheet's 10 mm of noise, and twice that. With all headers."""
    for seed in range(5):
        message = room_scan(noise, seed)
        coded, exact = (encoded(message, exact=exact) for exact in (False, True))
        assert size_on_air(coded) <= 1400 < 3 * 1400 <= size_on_air(exact)
        assert sum(map(len, coded)) == 2    # one datagram for each half
        finite = np.isfinite(message.ranges)
        ranges, _ = shown(coded)
        assert abs(ranges[finite].astype(float) - message.ranges[finite]).max() <= 0.000501
        assert (ranges[~finite] == np.inf).all()
        for lost in 0, 1:
            half, _ = shown(coded, [lost])
            np.testing.assert_array_equal(half[1 - lost::2], ranges[1 - lost::2])
            assert np.isnan(half[lost::2]).all()


@given(st.lists(st.floats(-100, 100, width=32) | st.sampled_from([math.inf, -math.inf, math.nan, 0.1, 30.0, -0.0]),
                max_size=60), st.sampled_from([0.0001, 0.001, 0.025, 1.0]), st.floats(0, 1, width=32),
       st.floats(1, 60, width=32))
def test_any_range_stays_what_it_is(ranges: List[float], resolution: float, low: float, high: float) -> None:
    """Infinite, NaN, too near or too far; and its value to a step at worst."""
    message = laser_scan(ranges=np.float32(ranges), range_min=low, range_max=high, angle_increment=0.01)
    found, _ = shown(encoded(message, exact=False, resolution=resolution)) if ranges else (message.ranges, None)
    for test in np.isnan, np.isposinf, np.isneginf, lambda r: r < np.float32(low), lambda r: r > np.float32(high):
        np.testing.assert_array_equal(test(found), test(message.ranges))
    finite = np.isfinite(message.ranges)
    errors = abs(found[finite].astype(float) - message.ranges[finite])
    assert (errors < resolution * (1 + 1e-6) + 1e-5).all()


def test_millimetres_stay_exact_and_so_do_intensities() -> None:
    message = room_scan(0.01, 1)
    message.ranges = np.where(np.isfinite(message.ranges), in_millimetres(np.rint(
        np.minimum(message.ranges, 60) * 1000)), message.ranges)
    message.intensities = np.float32(np.arange(1081) % 300)
    frames = encoded(message, intensity=True, exact=False)
    assert {int(frame.records['intensity_size'][0]) for frame in frames} == {255}
    ranges, intensities = shown(frames)
    np.testing.assert_array_equal(ranges, message.ranges)
    np.testing.assert_array_equal(intensities, message.intensities)


def test_what_steps_do_not_make_shorter_is_exact() -> None:
    random = np.random.RandomState(3)
    for ranges in in_millimetres(random.randint(0, 65000, 1081)), np.full(100, 1e9), np.full(20, 3e38):
        message = laser_scan(ranges=np.float32(ranges), range_max=math.inf)
        frames = encoded(message, exact=False)
        assert frames[0].records['range_size'][0] in (2, 4)
        np.testing.assert_array_equal(shown(frames)[0], message.ranges)


def test_fractions_of_intensities_are_exact() -> None:
    message = room_scan(0.01, 2)
    message.intensities = np.float32(np.arange(1081) / 7)
    np.testing.assert_array_equal(shown(encoded(message, intensity=True, exact=False))[1], message.intensities)


def test_a_long_scan_has_more_parts() -> None:
    message = laser_scan(ranges=np.float32(10 + np.random.RandomState(2).normal(0, 0.3, 30000)))
    frames = encoded(message, exact=False)
    count = sum(len(frame) for frame in frames)
    assert count == frames[0].records['parts'][0] and count in (32, 64)
    np.testing.assert_allclose(shown(frames)[0], message.ranges, atol=0.000501)
