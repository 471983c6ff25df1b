# SPDX-License-Identifier: BSD-3-Clause
"""Virtual 2D scan streams: obstacles or landmarks of a point cloud as a laser scan (D6.3, section 6.2).

The method is that of the deliverable's reference [2], see codecs/perception/virtual_scan.py. The scan is also published
on the robot, for localisation and navigation. On the wire it is a scan stream like any other: its ranges are whole
millimetres, so it takes two datagrams.
"""
from typing import Any, Mapping, Optional

import numpy as np
from sensor_msgs.msg import LaserScan, PointCloud2

from ...codecs.perception import virtual_scan
from ...codecs.wire.scan import in_millimetres
from ...frame_names import BASE_FRAME, is_unknown_transform
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import ScanSegment
from ...numpy_messages import numpy_msg
from ..encoder import Encoded, Encoder, LinkView
from ..parameters import ROBOT
from ..scan.encoder import scan_frames
from ..segments import MAIN_PART, size_on_air
from .fans import FanCache

Scan = numpy_msg(LaserScan)
SELECT = ('obstacle', 'landmark')

STEP = 1000
"""Step of ranges on the wire, which are multiples of it and so stay exact [um]."""


class VirtualScanEncoder(Encoder[Any]):
    """Makes a scan of each cloud, and sends it.

    :param fans: shared with other streams of the same topic; None: it has its own, without transforms
    """
    MESSAGE, SEGMENTS, DERIVED = PointCloud2, {MAIN_PART: ScanSegment}, Scan
    PARAMETERS = {
        **ROBOT,
        'select': Parameter('obstacle', '', 'obstacle: the nearest obstacles; landmark: the farthest walls',
                            choices=SELECT, live=True),
        'scan_topic': Parameter('', '', "topic of the scan on the robot; empty: the stream's name"),
        'base_frame': Parameter(BASE_FRAME, '', 'level frame on the floor; where tf does not know it, the settings of '
                                'the mount are used; default: base of frames'),
        'mount_height': Parameter(0.9, 'm', 'height of the sensor above the floor', least=0.0, most=100.0, live=True),
        'mount_roll': Parameter(0.0, 'rad', 'roll of the sensor', least=-1.6, most=1.6, live=True),
        'mount_pitch': Parameter(0.0, 'rad', 'pitch of the sensor; > 0 looks down', least=-1.6, most=1.6, live=True),
        'min_height': Parameter(0.1, 'm', 'points lower than this above the ground belong to the ground', least=0.0,
                                most=10.0, live=True),
        'slope': Parameter(0.0, '', 'added to min_height for each metre of distance, for uneven floors', least=0.0,
                           most=1.0, live=True),
        'max_height': Parameter(1.2, 'm', 'points higher than this are no obstacles; more than the height of the robot',
                                above=0.0, most=100.0, live=True),
        'range_min': Parameter(0.3, 'm', 'nearer points are the robot itself', least=0.0, most=10.0, live=True),
        'range_max': Parameter(60.0, 'm', 'farther points are ignored', above=0.0, most=1000.0, live=True),
    }

    def __init__(self, settings: Mapping[str, Any], fans: Optional[FanCache] = None) -> None:
        super().__init__(settings)
        self._fans = fans or FanCache()

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        for low, high in (('min_height', 'max_height'), ('range_min', 'range_max')):
            if settings[low] >= settings[high]:
                raise ValueError('%s is %g, not below %s, %g' % (low, settings[low], high, settings[high]))

    def derive(self, message: Any, settings: Settings) -> Any:
        """The LaserScan of a PointCloud2."""
        fan, frame, problems = self._fans.fan(message, settings)
        self.warnings += problems
        self.problem = next((one for one in problems if is_unknown_transform(one)), None)
        if settings['select'] == 'obstacle':
            ranges = virtual_scan.obstacle_scan(fan, settings['max_height'])
        else:
            ranges = virtual_scan.landmark_scan(fan)
        finite = np.isfinite(ranges)
        ranges[finite] = in_millimetres(np.rint(ranges[finite] * 1000))
        scan = Scan(angle_min=virtual_scan.ANGLE_MIN, angle_increment=virtual_scan.INCREMENT,
                    angle_max=virtual_scan.ANGLE_MIN + (virtual_scan.COLUMNS - 1) * virtual_scan.INCREMENT,
                    range_min=settings['range_min'], range_max=settings['range_max'], ranges=ranges,
                    intensities=np.zeros(0, np.float32))
        scan.header.stamp, scan.header.frame_id = message.header.stamp, frame
        return scan

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        frames = scan_frames(message, False, link.datagram_size, STEP)
        self.message_size = size_on_air(frames)
        return Encoded(frames)
