# SPDX-License-Identifier: BSD-3-Clause
"""Scan streams: sensor_msgs/LaserScan, even and odd indexes apart (D6.3, section 6.2)."""
import itertools
import math
from typing import Any, Dict, List, Mapping, Tuple

import numpy as np
from sensor_msgs.msg import LaserScan

from ...codecs.wire.scan import FIXED, MICROMETRES, write_scan
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import ScanSegment
from ...numpy_messages import numpy_msg
from ...udpros.frame import Frame
from ..encoder import Encoded, Encoder, LinkView
from ..parameters import ROBOT
from ..segments import MAIN_PART, as_bytes, room, size_on_air, write_header

ANGLES = 'angle_min', 'angle_max', 'angle_increment'
NEUTRAL = {'time_increment': 0.0, 'scan_time': 0.0, 'range_min': 0.0, 'range_max': math.inf}
"""{field: the value that says nothing}"""


class ScanEncoder(Encoder[Any]):
    """Sends each scan in two datagrams, each of which covers the whole field of view and is useful alone."""
    MESSAGE, SEGMENTS = numpy_msg(LaserScan), {MAIN_PART: ScanSegment}
    PARAMETERS = {
        **ROBOT,
        'resolution': Parameter(0.001, 'm', 'ranges are rounded to multiples of this: the resolution of the sensor',
                                least=0.0001, most=1.0, live=True),
        'exact': Parameter(False, '', 'send the ranges as they are, in 2 to 4 times the bytes', live=True),
        'intensity': Parameter(False, '', 'send intensities, where the scan has them', live=True),
    }

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        message, problems = corrected(message)
        self.warnings += problems
        step = 0 if settings['exact'] else round(MICROMETRES * settings['resolution'])
        frames = scan_frames(message, settings['intensity'], link.datagram_size, step)
        self.message_size = size_on_air(frames)
        return Encoded(frames)


def corrected(message: Any) -> Tuple[Any, List[str]]:
    """A LaserScan whose fields agree with its ranges, and what was wrong with them.

    Where the ranges lie is known by two of angle_min, angle_max and angle_increment, and of a single one by the first.
    What else is impossible is replaced by what says nothing: times by 0, limits of the ranges by 0 and infinity.

    :return: the message itself where it needs no change
    :raises ValueError: it is not known where the ranges lie
    """
    found = {field: float(getattr(message, field)) for field in FIXED}
    wanted = {**found, **_angles(found, len(message.ranges))}
    for field, neutral in NEUTRAL.items():
        if not math.isfinite(found[field]) and found[field] != neutral:
            wanted[field] = neutral
    problems = ['%s is %r, by the ranges it is %g' % (field, found[field], wanted[field]) if field in ANGLES else
                '%s is %r, %g is sent' % (field, found[field], wanted[field])
                for field in FIXED if found[field] != wanted[field]]
    intensities = message.intensities
    if len(intensities) not in (0, len(message.ranges)):
        problems.append('it has %d intensities, but %d ranges: no intensity is sent' % (
            len(intensities), len(message.ranges)))
        intensities = []
    if not problems:
        return message, problems
    return LaserScan(header=message.header, ranges=message.ranges, intensities=intensities, **wanted), problems


def _angles(found: Mapping[str, float], count: int) -> Dict[str, float]:
    """The angles by which the ranges lie [rad].

    :param found: by name, as the scan has them
    :raises ValueError: they are not known
    """
    low, high, step = (found[field] for field in ANGLES)
    last = max(count - 1, 0)
    if last and not (math.isfinite(step) and step):
        step = (high - low) / last
    if not math.isfinite(step) or last and not step:
        if last:
            raise ValueError('angle_increment is %r' % found['angle_increment'])
        step = 0.0
    if not math.isfinite(low):
        low = high - last * step if count else 0.0
        if not math.isfinite(low):
            raise ValueError('angle_min is %r' % found['angle_min'])
    end = low + last * step
    # many drivers are off by a step, or count on from turn to turn
    agrees = math.isfinite(high) and (not last or abs(math.remainder(high - end, 2 * math.pi)) < 1.5 * abs(step))
    return {'angle_min': low, 'angle_max': high if agrees else end, 'angle_increment': step}


def scan_frames(message: Any, with_intensity: bool, max_datagram_size: int, step: int) -> List[Frame]:
    """The frames that carry a LaserScan.

    :param message: as of `corrected`
    :param max_datagram_size: [byte of UDP payload]
    :param step: of ranges, as of write_scan [um]
    :raises ValueError: where one range does not fit in a datagram
    """
    intensities = np.asarray(message.intensities, np.float32) if with_intensity and len(message.intensities) else None
    frame_id = message.header.frame_id.encode()
    written = write_scan(np.asarray(message.ranges, np.float32), intensities,
                         room(ScanSegment, max_datagram_size, frame_id), step, (message.range_min, message.range_max))
    frames, number = [], 0
    # all messages of a frame have one size
    for sizes, some in itertools.groupby(written.parts, lambda part: tuple(map(len, part))):
        parts = list(some)
        frame = Frame(ScanSegment, len(parts), {
            'header.frame_id': len(frame_id), 'ranges': sizes[0], 'intensities': sizes[1]})
        records = frame.records
        write_header(records, message.header)
        for field in FIXED:
            records[field] = getattr(message, field)
        records['total'], records['parts'] = len(message.ranges), len(written.parts)
        records['part'] = number + np.arange(len(parts))
        records['range_size'], records['intensity_size'], records['step'] = written[:3]
        for record, part in zip(records, parts):
            record['ranges'], record['intensities'] = map(as_bytes, part)
        frames.append(frame)
        number += len(parts)
    return frames
