# SPDX-License-Identifier: BSD-3-Clause
"""Scans on the operator's side, and both sides of a stream: an encoder's datagrams to an assembler's message."""
import math
from typing import Any, Sequence

import numpy as np
import pytest
from sensor_msgs.msg import LaserScan

from evaluation.offline_link import assemble_all, operator_side
from smokebot_udp.codecs.wire.scan import FIXED, in_millimetres
from smokebot_udp.streams.scan.encoder import scan_frames


def scanner(count: int = 720) -> LaserScan:
    """A scan as drivers publish it: whole millimetres, intensities of a byte."""
    random = np.random.RandomState(1)
    message = LaserScan(angle_min=-1.5, angle_increment=0.25, time_increment=0.125, range_max=30.0,
                        ranges=in_millimetres(random.randint(50, 30000, count)),
                        intensities=random.randint(0, 256, count).astype(np.float32))
    message.header.stamp.secs, message.header.stamp.nsecs, message.header.frame_id = 5, 7, 'k\u00e9p'
    message.angle_max = message.angle_min + (count - 1) * message.angle_increment
    return message


def received(message: LaserScan, lost: Sequence[int] = (), kind: str = 'scan', **settings: Any) -> Any:
    """The Assembled of a scan whose parts are received but for the lost ones."""
    batches = [frame.records[~np.isin(frame.records['part'], lost)] for frame in scan_frames(message, True, 1472, 0)]
    assembled, = assemble_all(*operator_side(kind, **settings), batches)
    return assembled


@pytest.mark.parametrize('gaps', ['nan', 'thin'])
@pytest.mark.parametrize('count', [0, 1, 720, 721, 5000])
@pytest.mark.parametrize('kind', ['scan', 'virtual_scan'])
def test_a_whole_scan_is_published_as_it_was(count: int, gaps: str, kind: str) -> None:
    message, assembled = scanner(count), received(scanner(count), kind=kind, gaps=gaps)
    out = assembled.message
    assert out.ranges.dtype == out.intensities.dtype == np.float32
    assert out.ranges.tobytes() == message.ranges.tobytes()
    assert out.intensities.tobytes() == message.intensities.tobytes()
    for field in FIXED:
        assert getattr(out, field) == np.float32(getattr(message, field))
    assert (out.header.frame_id, out.header.stamp.to_nsec()) == ('k\u00e9p', 5 * 10 ** 9 + 7)
    assert (assembled.stamp, assembled.completeness) == (5 * 10 ** 9 + 7, 1.0)


def test_a_lost_half_is_nan_or_thins_the_scan() -> None:
    message = scanner()
    assembled = received(message, lost=[0], gaps='nan')
    out = assembled.message
    assert assembled.completeness == 0.5
    assert np.isnan(out.ranges[::2]).all() and out.ranges[1::2].tobytes() == message.ranges[1::2].tobytes()
    assert (out.angle_min, out.angle_increment, out.angle_max) == (-1.5, 0.25, message.angle_max)
    out = received(message, lost=[0], gaps='thin').message
    assert out.ranges.tobytes() == message.ranges[1::2].tobytes()
    assert out.intensities.tobytes() == message.intensities[1::2].tobytes()
    assert (out.angle_min, out.angle_increment, out.angle_max) == (-1.25, 0.5, message.angle_max)
    assert (out.time_increment, out.range_max) == (0.25, 30.0)


def test_a_thin_scan_says_where_its_ranges_are() -> None:
    message = LaserScan(angle_min=1.0, angle_increment=0.1, time_increment=0.2, angle_max=1.4,
                        ranges=np.float32([1, 2, 3, 4, 5]), intensities=[])
    out = received(message, lost=[0], gaps='thin').message
    assert out.ranges.tolist() == [2, 4]
    assert out.angle_min == pytest.approx(1.1) and out.angle_increment == pytest.approx(0.2)
    assert out.angle_max == pytest.approx(1.3) and out.time_increment == pytest.approx(0.4)


def test_a_head_of_no_numbers_begins_no_scan() -> None:
    frame, = scan_frames(scanner(), False, 1472, 0)
    frame.records['angle_increment'] = math.nan
    assembler, settings = operator_side('scan')
    assert assemble_all(assembler, settings, [frame.records]) == []
    assert assembler.dropped['impossible head'] == 2 and assembler.deadline() is None


def test_echoes_of_one_scanner_are_scans_of_their_own() -> None:
    """One topic, one stamp, three frames: their datagrams mixed."""
    echoes, records = [], []
    for number, frame_id in enumerate(('first', 'last', 'strong')):
        message = scanner(720 + number)
        message.header.frame_id = frame_id
        echoes.append(message)
        records += [frame.records for frame in scan_frames(message, True, 1472, 0)]
    for seed in range(20):
        order = np.random.RandomState(seed).permutation(len(records))
        shown = assemble_all(*operator_side('scan'), [records[row] for row in order])
        assert sorted(one.message.header.frame_id for one in shown) == ['first', 'last', 'strong']
        for one in shown:
            sent, = (echo for echo in echoes if echo.header.frame_id == one.message.header.frame_id)
            assert one.message.ranges.tobytes() == sent.ranges.tobytes() and one.completeness == 1.0


def test_echoes_in_one_batch_are_told_apart() -> None:
    """The echoes have one length: the transport hands over segments of one layout together."""
    records = []
    for frame_id in ('first', 'other'):
        message = scanner()
        message.header.frame_id = frame_id
        records += [frame.records for frame in scan_frames(message, True, 1472, 0)]
    assembler, settings = operator_side('scan')
    shown = assemble_all(assembler, settings, [np.concatenate(records)])
    assert [one.message.header.frame_id for one in shown] == ['first', 'other'] and not sum(assembler.dropped.values())


def test_scans_of_one_stamp_are_told_apart_by_their_arrival() -> None:
    batches = []
    for number in range(3):
        message = scanner(720 + 2 * number)
        for frame in scan_frames(message, True, 1472, 0):
            frame.records['arrival']['secs'] = 1000 + number
            batches.append(frame.records)
    shown = assemble_all(*operator_side('scan'), batches)
    assert [len(one.message.ranges) for one in shown] == [720, 722, 724]
    assert {one.message.header.stamp.to_nsec() for one in shown} == {5 * 10 ** 9 + 7}
