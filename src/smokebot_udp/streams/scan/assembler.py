# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a scan to sensor_msgs/LaserScan, whole or with gaps (D6.3, section 6.2)."""
import math
from types import SimpleNamespace
from typing import Any, Tuple

import numpy as np
from sensor_msgs.msg import LaserScan

from ...arrays import Records
from ...codecs.wire.scan import FIXED, GAPS, ScanParts
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import ScanSegment
from ...numpy_messages import numpy_msg
from ..assembler import Assembled
from ..frame_assembler import Frame
from ..segments import MAIN_PART, MAX_SOURCES
from ..stamped_assembler import StampedAssembler, header_of


class ScanAssembler(StampedAssembler[ScanParts, Assembled]):
    """Makes one scan of each stamp's parts."""
    MESSAGE, SEGMENTS = numpy_msg(LaserScan), {MAIN_PART: ScanSegment}
    QUEUE_SIZE = MAX_SOURCES
    HEADS = {MAIN_PART: FIXED + ('total', 'parts', 'range_size', 'intensity_size', 'step')}
    PARAMETERS = {
        **StampedAssembler.PARAMETERS,
        'max_wait': Parameter(0.1, 's', 'longest time from the first part of a scan until the scan is published',
                              above=0.0, most=60.0, live=True),
        'gaps': Parameter('nan', '', 'what represents lost ranges: nan, or thin: the received ones are published with '
                          'a larger angle_increment', choices=GAPS, live=True),
    }

    def begin(self, head: SimpleNamespace) -> ScanParts:
        for field in FIXED:
            if math.isnan(getattr(head, field)):
                raise ValueError('%s is NaN' % field)
        return ScanParts(head.total, head.parts, head.range_size, head.intensity_size, head.step)

    def parts(self, records: Records, part: str) -> Tuple[Any, ...]:
        return records['part'].astype(int), records['ranges'], records['intensities']

    def assemble(self, finished: Frame[ScanParts], settings: Settings, still: bool, now: float) -> Assembled:
        head, scan = finished.head, finished.content
        try:
            ranges, intensities, (first, step) = scan.merge(settings['gaps'])
        finally:
            self.dropped['broken'] += scan.broken
        if intensities is None:
            intensities = np.zeros(0, np.float32)
        message = self.MESSAGE(header=header_of(head), ranges=ranges, intensities=intensities,
                               **{field: getattr(head, field) for field in FIXED})
        if step > 1:
            message.angle_min = head.angle_min + first * head.angle_increment
            message.angle_increment, message.time_increment = step * head.angle_increment, step * head.time_increment
            message.angle_max = message.angle_min + (len(ranges) - 1) * message.angle_increment
        return Assembled(message, head.stamp, scan.completeness)
