# SPDX-License-Identifier: BSD-3-Clause
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import LaserScan

from smokebot_udp.codecs.wire.scan import (
    MAX_RANGES,
    ScanParts,
    densest_comb,
    fit,
    in_millimetres,
    read_intensities,
    read_ranges,
    write_intensities,
    write_ranges,
)
from smokebot_udp.mission import parameters
from smokebot_udp.msg import ScanSegment
from smokebot_udp.streams.base import Link
from smokebot_udp.streams.scan import FIXED, ScanReceiver, check, scan_frames
from smokebot_udp.udpros.datagram import OVERHEAD

# by their bits: NaNs of every kind, -0.0 and denormals too; and what scanners tell
BITS = st.integers(0, 2 ** 32 - 1).map(lambda bits: np.uint32(bits).view(np.float32))
TOLD = (st.integers(0, 70000).map(lambda count: in_millimetres(np.array(count)))
        | st.sampled_from(np.float32([0, -0.0, np.inf, -np.inf, np.nan, 1e-45, -1e-45, 3.4e38])))
FLOATS = st.lists(BITS | TOLD, max_size=50).map(np.float32) | st.lists(TOLD, max_size=50).map(np.float32)


@given(FLOATS)
def test_any_range_is_exact(ranges):
    assert read_ranges(write_ranges(ranges)).tobytes() == ranges.tobytes()


@given(st.lists(st.integers(0, 65532), max_size=50))
def test_any_whole_millimetres_take_two_bytes(counts):
    assert write_ranges(in_millimetres(np.array(counts, int))).shape == (len(counts), 2)


@given(FLOATS | st.lists(st.integers(0, 66000), max_size=50).map(np.float32))
def test_any_intensity_is_exact(intensities):
    assert read_intensities(write_intensities(intensities)).tobytes() == intensities.tobytes()


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
    assert fit(3, 4, 4) == 3      # 4 parts of 3 ranges are none


@given(st.integers(1, MAX_RANGES), st.sampled_from([2, 3, 4, 6, 8]), st.integers(0, 1500))
def test_as_few_parts_as_fit(total, size, spare):
    parts = fit(total, size, size + spare)
    assert 1 <= parts <= total and -(-total // parts) * size <= size + spare
    assert parts <= 2 or -(-total // ((parts + 1) // 2)) * size > size + spare


def test_what_fits_in_no_parts():
    with pytest.raises(ValueError, match='262145 ranges are more than'):
        fit(MAX_RANGES + 1, 2, 1390)
    with pytest.raises(ValueError, match='8 bytes does not fit in 7'):
        fit(1, 8, 7)


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
    ranges, _, comb = parts_of(range(7), 4, [0, 1, 3]).merge('thin')
    assert ranges.tolist() == [1, 3, 5] and comb == (1, 2)
    ranges, _, comb = parts_of(range(7), 4, [1, 2]).merge('thin')
    assert ranges.tolist() == [1, 5] and comb == (1, 4)


def test_lost_ranges_lose_their_intensities():
    gathered = ScanParts(6, 4, 2, 1)
    for part, ranges, intensities in (0, [1000, 1004], [7, 8]), (3, [1003], [9]):
        assert gathered.add(np.array([part]), np.array([ranges], '<u2').view(np.uint8),
                            np.array([intensities], np.uint8)).all()
    assert gathered.completeness == 0.5 and gathered.ending
    ranges, intensities, comb = gathered.merge('nan')
    assert ranges.tobytes() == np.float32([1.0, np.nan, np.nan, 1.003, 1.004, np.nan]).tobytes() and comb == (0, 1)
    np.testing.assert_array_equal(intensities, np.float32([7, np.nan, np.nan, 9, 8, np.nan]))


@given(st.integers(1, 40), st.integers(1, 40), st.sampled_from(['nan', 'thin']), st.randoms())
def test_all_parts_in_any_order_make_the_exact_scan(total, parts, gaps, random):
    parts = min(parts, total)
    ranges = np.random.RandomState(total).rand(total).astype(np.float32)
    merged, intensities, comb = parts_of(ranges, parts, random.sample(range(parts), parts)).merge(gaps)
    assert merged.tobytes() == ranges.tobytes() and intensities is None and comb == (0, 1)


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
    *(({field: math.nan}, '%s is nan' % field) for field in FIXED),
    *(({field: -math.inf}, '%s is -inf' % field) for field in FIXED if field != 'range_max'),
    ({'angle_increment': 0.0}, 'angle_increment is 0'), ({'ranges': []}, 'no ranges'),
    ({'intensities': [1.0]}, '1 intensities, but 720 ranges')])
def test_what_is_wrong_is_named(changes, words):
    with pytest.raises(ValueError, match=words):
        check(laser_scan(**changes))
    check(laser_scan(range_max=math.inf))


def test_a_thin_scan_says_where_its_ranges_are():
    receiver = object.__new__(ScanReceiver)
    receiver.settings = {'gaps': 'thin'}
    head = SimpleNamespace(**{field: 0.0 for field in FIXED})
    head.angle_min, head.angle_increment, head.time_increment, head.angle_max = 1.0, 0.1, 0.2, 1.4
    message = receiver.message(head, parts_of([1, 2, 3, 4, 5], 2, [1]))
    assert message.ranges.tolist() == [2, 4]
    assert message.angle_min == pytest.approx(1.1) and message.angle_increment == pytest.approx(0.2)
    assert message.angle_max == pytest.approx(1.3) and message.time_increment == pytest.approx(0.4)


def scanner(count=720):
    """A scan as drivers tell it: whole millimetres, intensities of a byte."""
    random = np.random.RandomState(1)
    message = laser_scan(ranges=in_millimetres(random.randint(50, 30000, count)), angle_min=-1.5, angle_increment=0.25,
                         time_increment=0.125, intensities=random.randint(0, 256, count).astype(np.float32))
    message.header.stamp.secs, message.header.stamp.nsecs, message.header.frame_id = 5, 7, 'k\u00e9p'
    message.angle_max = message.angle_min + (count - 1) * message.angle_increment
    return message


def test_a_scanners_scan_takes_two_datagrams():
    message = scanner()
    for with_intensity, size in (False, 0), (True, 1):
        frames = scan_frames(message, with_intensity, 1472)
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


@given(st.integers(1, 300), st.integers(100, 1472))
def test_no_datagram_is_too_long(count, max_datagram_size):
    frames = scan_frames(laser_scan(count), False, max_datagram_size)
    assert max(frame.datagram_size for frame in frames) <= max_datagram_size
    parts = [part for frame in frames for part in frame.records['part'].tolist()]
    assert parts == list(range(frames[0].records['parts'][0]))


def received(message, lost=(), **settings):
    """What an operator's stream publishes of a scan, its parts but the lost ones in one batch each; needs no ROS."""
    stream = ScanReceiver('scan', parameters.check({'operator_topic': '/scan', **settings}, ScanReceiver.PARAMETERS),
                          Link(1472))
    for frame in scan_frames(message, True, 1472):
        stream.take(frame.records, ~np.isin(frame.records['part'], lost))
    finished = stream._finished[0] if stream._finished else stream._sequence.poll(math.inf)
    return stream.message(finished.picture.head, finished.picture)


@pytest.mark.parametrize('gaps', ['nan', 'thin'])
@pytest.mark.parametrize('count', [1, 720, 721, 5000])
def test_a_whole_scan_is_published_as_it_was(count, gaps):
    message, out = scanner(count), received(scanner(count), gaps=gaps)
    assert out.ranges.dtype == out.intensities.dtype == np.float32
    assert out.ranges.tobytes() == message.ranges.tobytes()
    assert out.intensities.tobytes() == message.intensities.tobytes()
    for field in FIXED:
        assert getattr(out, field) == np.float32(getattr(message, field))


def test_a_lost_half_is_nan_or_thins_the_scan():
    message = scanner()
    out = received(message, lost=[0], gaps='nan')
    assert np.isnan(out.ranges[::2]).all() and out.ranges[1::2].tobytes() == message.ranges[1::2].tobytes()
    assert (out.angle_min, out.angle_increment, out.angle_max) == (-1.5, 0.25, message.angle_max)
    out = received(message, lost=[0], gaps='thin')
    assert out.ranges.tobytes() == message.ranges[1::2].tobytes()
    assert out.intensities.tobytes() == message.intensities[1::2].tobytes()
    assert (out.angle_min, out.angle_increment, out.angle_max) == (-1.25, 0.5, message.angle_max)
    assert (out.time_increment, out.range_max) == (0.25, 30.0)


def test_a_head_of_no_numbers_begins_no_scan():
    stream = ScanReceiver('scan', parameters.check({'operator_topic': '/scan'}, ScanReceiver.PARAMETERS), Link(1472))
    frame, = scan_frames(scanner(), False, 1472)
    frame.records['angle_increment'] = np.nan
    stream.take(frame.records, np.ones(2, bool))
    assert stream._sequence.dropped['picture'] == 2 and stream._sequence.deadline is None
