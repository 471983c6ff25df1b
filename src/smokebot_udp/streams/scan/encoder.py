# SPDX-License-Identifier: BSD-3-Clause
"""Scan streams: sensor_msgs/LaserScan, even and odd indexes apart (D6.3, section 6.2)."""
import math
from typing import Any, List

import numpy as np
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan

from ...codecs.wire import scan
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import ScanSegment
from ...udpros.frame import Frame
from ..encoder import Encoder
from ..parameters import ROBOT
from ..segments import MAIN_PART, room, size_on_air, write_header
from .fields import FIXED


class ScanEncoder(Encoder[Any]):
    """Sends each scan in two datagrams, each of which covers the whole field of view."""
    MESSAGE, SEGMENTS = numpy_msg(LaserScan), {MAIN_PART: ScanSegment}
    PARAMETERS = {
        **ROBOT,
        'intensity': Parameter(False, '', 'send intensities, where the scan has them', live=True),
    }

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Frame]:
        check(message)
        frames = scan_frames(message, settings['intensity'], max_datagram_size)
        self.message_size = size_on_air(frames)
        return frames


def check(message: Any) -> None:
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


def scan_frames(message: Any, with_intensity: bool, max_datagram_size: int) -> List[Frame]:
    """The frames that carry a LaserScan.

    :param message: checked
    :param max_datagram_size: [byte of UDP payload]
    :raises ValueError: where one range does not fit in a datagram
    """
    ranges = scan.write_ranges(np.asarray(message.ranges, np.float32))
    intensities = (scan.write_intensities(np.asarray(message.intensities, np.float32))
                   if with_intensity and len(message.intensities) else np.zeros((len(ranges), 0), np.uint8))
    frame_id = message.header.frame_id.encode()
    left = room(ScanSegment, max_datagram_size, frame_id)
    parts = scan.fit(len(ranges), ranges.shape[1] + intensities.shape[1], left)
    frames = []
    # the first parts may be one value longer than the others, and all messages of a frame have one size
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
