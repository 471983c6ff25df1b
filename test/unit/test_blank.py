# SPDX-License-Identifier: BSD-3-Clause
import math

from sensor_msgs.msg import Image, LaserScan, PointCloud2, PointField
from std_msgs.msg import Header

from smokebot_udp.streams.blank import blank, has_blank

HEADER = Header(frame_id='ugv1/lidar')
HEADER.stamp.secs = 7


def test_a_blank_cloud_has_the_fields_and_no_points() -> None:
    fields = [PointField('x', 0, PointField.FLOAT32, 1)]
    found = blank(PointCloud2(header=HEADER, height=2, width=3, fields=fields, point_step=4, row_step=12,
                              data=bytes(24)))
    assert (found.header.frame_id, found.header.stamp.secs) == ('ugv1/lidar', 0)
    assert (found.height, found.width, found.row_step, found.data) == (1, 0, 0, b'')
    assert (found.fields, found.point_step) == (fields, 4)


def test_a_blank_scan_has_the_angles_and_nothing_but_nan() -> None:
    found = blank(LaserScan(header=HEADER, angle_min=-1.0, angle_max=1.0, angle_increment=1.0, time_increment=0.1,
                            range_min=0.1, range_max=9.0, ranges=[1.0, math.inf, 2.0], intensities=[1.0, 2.0, 3.0]))
    assert (found.header.frame_id, found.header.stamp.secs) == ('ugv1/lidar', 0)
    assert (found.angle_min, found.angle_max, found.angle_increment) == (-1.0, 1.0, 1.0)
    assert len(found.ranges) == 3 and all(map(math.isnan, found.ranges)) and not found.intensities
    assert found.time_increment == 0


def test_other_messages_have_none() -> None:
    assert has_blank(PointCloud2) and has_blank(LaserScan)
    assert not has_blank(Image) and blank(Image()) is None
