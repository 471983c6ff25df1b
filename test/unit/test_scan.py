# SPDX-License-Identifier: BSD-3-Clause
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from sensor_msgs.msg import LaserScan

from smokebot_udp.codecs.scan import (
    ScanParts,
    densest_comb,
    fit,
    in_millimetres,
    read_intensities,
    read_ranges,
    write_intensities,
    write_ranges,
)
from smokebot_udp.streams.scan import check, scan_frames


@given(arrays.arrays(np.float32, st.integers(1, 50), elements=st.floats(width=32)))
def test_any_range_is_exact(ranges):
    np.testing.assert_array_equal(read_ranges(write_ranges(ranges)), ranges)
    np.testing.assert_array_equal(np.signbit(read_ranges(write_ranges(ranges))), np.signbit(ranges))


def test_millimetres_take_two_bytes_and_rep_117_with_them():
    ranges = in_millimetres(np.array([0, 1, 1234, 65532]))
    ranges = np.append(ranges, np.float32([np.inf, -np.inf, np.nan]))
    written = write_ranges(ranges)
    assert written.shape == (7, 2)
    np.testing.assert_array_equal(read_ranges(written), ranges)
    assert write_ranges(np.float32([65.533])).shape == (1, 4)     # that number means something else
    assert write_ranges(np.float32([1.00005])).shape == (1, 4)


@pytest.mark.parametrize('values, size', [([0, 255], 1), ([0, 256], 2), ([0.5], 4), ([-1], 4), ([np.nan], 4),
                                          ([7e4], 4)])
def test_intensities_take_what_they_need(values, size):
    values = np.float32(values)
    written = write_intensities(values)
    assert written.shape[1] == size
    np.testing.assert_array_equal(read_intensities(written), values)


def test_two_parts_or_as_many_as_it_takes():
    assert fit(720, 2, 1390) == 2 and fit(681, 4, 1390) == 2
    assert fit(720, 4, 1390) == 4 and fit(20000, 4, 1390) == 64 and fit(1, 4, 1390) == 1


@given(st.lists(st.booleans(), min_size=1, max_size=16).filter(any))
def test_the_densest_comb(have):
    first, step = densest_comb(np.array(have))
    assert len(have) % step == 0 and all(have[first::step])
    denser = [(f, s) for s in range(1, step) if len(have) % s == 0 for f in range(s) if all(have[f::s])]
    assert not denser


def parts_of(ranges, parts, received):
    gathered = ScanParts(len(ranges), parts, 4, 0)
    data = np.ascontiguousarray(np.float32(ranges)).view(np.uint8).reshape(-1, 4)
    for part in received:
        good = gathered.add(np.array([part]), data[part::parts].reshape(1, -1), np.zeros((1, 0), np.uint8))
        assert good.all()
    return gathered


def test_one_half_lost():
    gathered = parts_of([1, 2, 3, 4, 5], 2, [1])
    ranges, intensities, comb = gathered.merge('nan')
    np.testing.assert_array_equal(ranges, np.float32([np.nan, 2, np.nan, 4, np.nan]))
    assert intensities is None and comb == (0, 1) and gathered.ending and not gathered.complete
    ranges, _, comb = gathered.merge('thin')
    assert ranges.tolist() == [2, 4] and comb == (1, 2)


def test_three_of_four_parts_make_every_second_range():
    ranges, _, comb = parts_of(range(8), 4, [0, 1, 2]).merge('thin')
    assert ranges.tolist() == [0, 2, 4, 6] and comb == (0, 2)


@pytest.mark.parametrize('numbers', [(0, 1, 4, 0), (5, 0, 4, 0), (5, 6, 4, 0), (2 ** 32 - 1, 2, 4, 0), (5, 2, 3, 0),
                                     (5, 2, 4, 5)])
def test_impossible_scans_are_refused(numbers):
    with pytest.raises(ValueError):
        ScanParts(*numbers)


def test_parts_that_do_not_fit_are_dropped():
    gathered = ScanParts(5, 2, 4, 1)
    for part, ranges, intensities in ((2, 12, 3), (0, 11, 3), (0, 12, 2), (65535, 8, 2)):
        assert not gathered.add(np.array([part]), np.zeros((1, ranges), np.uint8),
                                np.zeros((1, intensities), np.uint8)).any()


def laser_scan(count=720, **changes):
    message = LaserScan(angle_min=-math.pi, angle_max=math.pi, angle_increment=0.01, range_max=30.0,
                        ranges=np.random.RandomState(0).rand(count), intensities=[])
    message.header.frame_id = 'laser'
    for name, value in changes.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize('count', [1, 2, 3, 681, 720, 1081, 20001])
def test_segments_fit_and_make_the_scan_again(count):
    message = laser_scan(count, intensities=list(range(count)))
    frames = scan_frames(message, True, 1472)
    record = frames[0].records[0]
    gathered = ScanParts(int(record['total']), int(record['parts']), int(record['range_size']),
                         int(record['intensity_size']))
    for frame in frames:
        assert frame.datagram_size <= 1472
        assert gathered.add(frame.records['part'].astype(int), frame.records['ranges'],
                            frame.records['intensities']).all()
    ranges, intensities, _ = gathered.merge('nan')
    np.testing.assert_array_equal(ranges, np.float32(message.ranges))
    np.testing.assert_array_equal(intensities, np.float32(message.intensities))


@pytest.mark.parametrize('changes, words', [
    ({'angle_increment': math.nan}, 'angle_increment is nan'), ({'time_increment': math.inf}, 'time_increment is inf'),
    ({'angle_increment': 0.0}, 'angle_increment is 0'), ({'ranges': []}, 'no ranges'),
    ({'intensities': [1.0]}, '1 intensities, but 720 ranges')])
def test_what_is_wrong_is_named(changes, words):
    with pytest.raises(ValueError, match=words):
        check(laser_scan(**changes))
    check(laser_scan(range_max=math.inf))


def test_a_thin_scan_says_where_its_ranges_are():
    from smokebot_udp.streams.scan import FIXED, ScanReceiver
    receiver = object.__new__(ScanReceiver)
    receiver.settings = {'gaps': 'thin'}
    head = SimpleNamespace(**{field: 0.0 for field in FIXED})
    head.angle_min, head.angle_increment, head.time_increment, head.angle_max = 1.0, 0.1, 0.2, 1.4
    message = receiver.message(head, parts_of([1, 2, 3, 4, 5], 2, [1]))
    assert message.ranges.tolist() == [2, 4]
    assert message.angle_min == pytest.approx(1.1) and message.angle_increment == pytest.approx(0.2)
    assert message.angle_max == pytest.approx(1.3) and message.time_increment == pytest.approx(0.4)
