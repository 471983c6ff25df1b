# SPDX-License-Identifier: BSD-3-Clause
"""Scan streams: sensor_msgs/LaserScan, even and odd indexes apart (D6.3, section 6.2)."""
import math

import numpy as np
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan

from ..codecs.wire import scan
from ..mission.parameters import Parameter
from ..msg import ScanSegment
from ..udpros import Frame
from .base import RobotStream
from .gather import GatheringReceiver
from .parameters import ROBOT
from .segments import room, write_header

FIXED = 'angle_min', 'angle_max', 'angle_increment', 'time_increment', 'scan_time', 'range_min', 'range_max'
"""The fields of a LaserScan that every segment repeats."""


class ScanSender(RobotStream):
    """Sends each scan in two datagrams, each of which shows all around."""
    MESSAGE, SEGMENT = numpy_msg(LaserScan), ScanSegment
    PARAMETERS = {
        **ROBOT,
        'intensity': Parameter(False, '', 'whether intensities are sent, where the scan has them', live=True),
    }

    def frames(self, message):
        check(message)
        return scan_frames(message, self.settings['intensity'], self.link.datagram_size)


def check(message):
    """:raises ValueError: naming the field of a LaserScan that is wrong and its value"""
    for field in FIXED:
        value = getattr(message, field)
        if math.isnan(value) or (math.isinf(value) and field != 'range_max'):
            raise ValueError('%s is %r' % (field, value))
    if not len(message.ranges):
        raise ValueError('it has no ranges')
    if message.angle_increment == 0 and len(message.ranges) > 1:
        raise ValueError('angle_increment is 0')
    if len(message.intensities) not in (0, len(message.ranges)):
        raise ValueError('it has %d intensities, but %d ranges' % (len(message.intensities), len(message.ranges)))


def scan_frames(message, with_intensity, max_datagram_size):
    """The udpros.Frames that carry a checked LaserScan."""
    ranges = scan.write_ranges(np.asarray(message.ranges, np.float32))
    intensities = (scan.write_intensities(np.asarray(message.intensities, np.float32))
                   if with_intensity and len(message.intensities) else np.zeros((len(ranges), 0), np.uint8))
    frame_id = message.header.frame_id.encode()
    left = room(ScanSegment, max_datagram_size, frame_id)
    parts = scan.fit(len(ranges), ranges.shape[1] + intensities.shape[1], left)
    frames = []
    # the first parts may be one value longer than the others: as many layouts
    longer = len(ranges) % parts
    for some in (range(longer or parts), range(longer, parts) if longer else range(0)):
        if not len(some):
            continue
        count = -(-(len(ranges) - some[0]) // parts)
        frame = Frame(ScanSegment, len(some), {
            'header.frame_id': len(frame_id), 'ranges': count * ranges.shape[1],
            'intensities': count * intensities.shape[1]})
        records = frame.records
        write_header(records, message.header)
        for field in FIXED:
            records[field] = getattr(message, field)
        records['total'], records['parts'], records['part'] = len(ranges), parts, some
        records['range_size'], records['intensity_size'] = ranges.shape[1], intensities.shape[1]
        for record, part in zip(records, some):
            record['ranges'], record['intensities'] = ranges[part::parts].ravel(), intensities[part::parts].ravel()
        frames.append(frame)
    return frames


class ScanReceiver(GatheringReceiver):
    """Publishes each stamp's scan: whole, or what came of it."""
    MESSAGE, SEGMENT = numpy_msg(LaserScan), ScanSegment
    HEAD = FIXED + ('total', 'parts', 'range_size', 'intensity_size')
    PARAMETERS = {
        **GatheringReceiver.PARAMETERS,
        'max_wait': Parameter(0.1, 's', 'a scan is shown at the latest so long after its first part came', above=0.0,
                              most=60.0, live=True),
        'gaps': Parameter('nan', '', 'what becomes of ranges that did not come: nan, or thin: the others with a wider '
                          'angle_increment', choices=scan.GAPS, live=True),
    }

    def begin(self, head):
        check_head(head)
        return scan.ScanParts(head.total, head.parts, head.range_size, head.intensity_size)

    def parts(self, records):
        return records['part'].astype(int), records['ranges'], records['intensities']

    def message(self, head, picture):
        ranges, intensities, (first, step) = picture.merge(self.settings['gaps'])
        if intensities is None:
            intensities = np.zeros(0, np.float32)
        message = self.MESSAGE(ranges=ranges, intensities=intensities)
        for field in FIXED:
            setattr(message, field, getattr(head, field))
        if step > 1:
            message.angle_min = head.angle_min + first * head.angle_increment
            message.angle_increment, message.time_increment = step * head.angle_increment, step * head.time_increment
            message.angle_max = message.angle_min + (len(ranges) - 1) * message.angle_increment
        return message


def check_head(head):
    """:raises ValueError: where a segment's numbers cannot be shown"""
    for field in FIXED:
        if math.isnan(getattr(head, field)):
            raise ValueError('%s is NaN' % field)
