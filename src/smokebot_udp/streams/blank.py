# SPDX-License-Identifier: BSD-3-Clause
"""Messages without any point, in place of a cloud or a scan that is no longer true: displays keep the last message.

A blank message has the stamp 0: it is not from the source. Displays transform it with the latest transforms. A blank
scan has as many ranges as the one before, all NaN, which means erroneous (REP-117): unlike +Inf, nothing seems free.
"""
import math
from typing import Any, Callable, Dict, Optional

from sensor_msgs.msg import LaserScan, PointCloud2
from std_msgs.msg import Header


def _blank_cloud(cloud: Any) -> Any:
    return PointCloud2(header=Header(frame_id=cloud.header.frame_id), height=1, width=0, fields=cloud.fields,
                       is_bigendian=cloud.is_bigendian, point_step=cloud.point_step, row_step=0, data=b'',
                       is_dense=True)


def _blank_scan(scan: Any) -> Any:
    # without time_increment: with stamp 0 displays would ask for transforms of the year 1970
    return LaserScan(header=Header(frame_id=scan.header.frame_id), angle_min=scan.angle_min, angle_max=scan.angle_max,
                     angle_increment=scan.angle_increment, scan_time=scan.scan_time, range_min=scan.range_min,
                     range_max=scan.range_max, ranges=[math.nan] * len(scan.ranges))


_BLANKS: Dict[str, Callable[[Any], Any]] = {PointCloud2._type: _blank_cloud, LaserScan._type: _blank_scan}


def has_blank(message_class: Any) -> bool:
    """Whether messages of this class have a blank one."""
    return message_class is not None and message_class._type in _BLANKS


def blank(message: Any) -> Optional[Any]:
    """The blank message for a sensor_msgs/PointCloud2 or LaserScan; None for any other message."""
    make = _BLANKS.get(message._type)
    return None if make is None else make(message)
