# SPDX-License-Identifier: BSD-3-Clause
import copy
import math
from typing import Any, List, Tuple

import numpy as np
import pytest
from genpy import Time
from sensor_msgs.msg import PointCloud2, PointField

from evaluation.linked_encoder import LinkedEncoder
from smokebot_udp.codecs.perception.virtual_scan import COLUMNS
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import ScanSegment
from smokebot_udp.rotation import rotation
from smokebot_udp.streams.virtual_scan.encoder import VirtualScanEncoder
from smokebot_udp.streams.virtual_scan.fans import FanCache, mounting
from smokebot_udp.udpros.datagram import OVERHEAD

MOUNT, AHEAD = 0.9, COLUMNS // 2
FIELDS = [PointField(name, 4 * k, PointField.FLOAT32, 1) for k, name in enumerate('xyz')]


def room() -> Any:
    """(n, 3) float32: a floor, and a wall 5 m ahead, seen from a sensor 0.9 m above the floor."""
    angles = np.radians(np.arange(-180, 180, 0.5))
    floor = [(r * np.cos(a), r * np.sin(a), -MOUNT) for r in np.arange(1, 5, 0.25) for a in angles]
    wall = [(5.0, y, z - MOUNT) for y in np.arange(-3, 3, 0.02) for z in (0.3, 0.6, 0.9, 1.5, 2.0)]
    return np.array(floor + wall, np.float32)


def cloud(points: Any, frame_id: str = 'velodyne') -> Any:
    message = PointCloud2(height=1, width=len(points), point_step=12, row_step=12 * len(points), fields=FIELDS,
                          data=np.asarray(points, np.float32).tobytes())
    message.header.stamp, message.header.frame_id = Time(5, 7), frame_id
    return message


def settings(**changes: Any) -> Settings:
    return Settings(check({'robot_topic': '/points', **changes}, VirtualScanEncoder.PARAMETERS))


def scan_of(message: Any, *shared: Any, **changes: Any) -> Any:
    of = settings(**changes)
    return VirtualScanEncoder(of.requested, *shared).derive(message, of)


@pytest.mark.parametrize('select', ['obstacle', 'landmark'])
def test_the_scan_of_a_wall(select: str) -> None:
    scan = scan_of(cloud(room()), select=select)
    assert scan.ranges[AHEAD] == pytest.approx(5.0, abs=0.02) and scan.ranges.shape == (COLUMNS,)
    assert (scan.header.stamp, scan.header.frame_id) == (Time(5, 7), 'velodyne')
    assert (scan.range_min, scan.range_max) == (settings()['range_min'], settings()['range_max'])
    assert scan.angle_min + (COLUMNS - 1) * scan.angle_increment == pytest.approx(scan.angle_max)
    finite = scan.ranges[np.isfinite(scan.ranges)]
    assert np.abs(finite * 1000 - np.rint(finite * 1000)).max() < 1e-2


def test_a_scan_takes_two_datagrams_of_whole_millimetres() -> None:
    of = settings()
    encoder = LinkedEncoder(VirtualScanEncoder(of.requested))
    scan = encoder.derive(cloud(room()), of)
    frames = encoder.encode(scan, of, 1472)
    segments = [ScanSegment().deserialize(row[OVERHEAD:].tobytes()) for frame in frames for row in frame.rows]
    found = [(one.total, one.parts, one.range_size, one.intensity_size) for one in segments]
    assert found == [(COLUMNS, 2, 255, 0)] * 2
    assert {one.step for one in segments} == {1000}
    assert encoder.operating_points(10.0, of)[-1].settings == {'rate': 10.0}


def test_what_is_not_tilted_is_found_level_by_the_mount() -> None:
    for roll, pitch in ((0.3, 0.0), (0.0, 0.2), (-0.1, 0.25)):
        tilted = room() @ mounting(roll, pitch)      # as the sensor sees it
        scan = scan_of(cloud(tilted), mount_roll=roll, mount_pitch=pitch)
        assert scan.ranges[AHEAD] == pytest.approx(5.0, abs=0.03)


def test_a_sensor_that_looks_down_sees_what_is_ahead_above() -> None:
    """REP 103: x forward, y left, z up; pitch > 0 looks down."""
    assert mounting(0.0, math.pi / 2) @ [1, 0, 0] == pytest.approx([0, 0, -1], abs=1e-6)
    assert mounting(math.pi / 2, 0.0) @ [0, 1, 0] == pytest.approx([0, 0, 1], abs=1e-6)
    assert rotation(0, 0, math.sqrt(0.5), math.sqrt(0.5)) @ [1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-6)


def test_what_tf_knows_counts_more_than_the_mount() -> None:
    asked = []

    def lookup(frame: str, header: Any) -> Tuple[Any, Any]:
        asked.append((frame, header.frame_id))
        return np.eye(3, dtype=np.float32), np.array([0, 0, MOUNT], np.float32)

    scan = scan_of(cloud(room()), FanCache(lookup), mount_height=5.0, mount_pitch=1.0)
    assert scan.ranges[AHEAD] == pytest.approx(5.0, abs=0.02) and scan.header.frame_id == 'base_link'
    assert asked == [('base_link', 'velodyne')]
    scan = scan_of(cloud(room()), FanCache(lookup), base_frame='')
    assert scan.header.frame_id == 'velodyne' and len(asked) == 1


def test_streams_of_one_topic_share_the_work() -> None:
    lookups: List[str] = []
    fans, message = FanCache(lambda frame, header: lookups.append(frame)), cloud(room())
    for select in ('obstacle', 'landmark'):
        scan_of(message, fans, select=select)
    assert len(lookups) == 1
    scan_of(message, fans, min_height=0.2)      # it sees the cloud differently
    scan_of(copy.copy(message), fans, min_height=0.2)
    assert len(lookups) == 3


@pytest.mark.parametrize('changes, words', [
    ({'min_height': 1.2}, 'min_height is 1.2, not below max_height, 1.2'),
    ({'range_min': 5.0, 'range_max': 5.0}, 'range_min is 5, not below range_max, 5')])
def test_settings_that_contradict_each_other(changes: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        VirtualScanEncoder(settings(**changes).requested)


@pytest.mark.parametrize('select', ['obstacle', 'landmark'])
def test_where_nothing_was_seen_nothing_is_free(select: str) -> None:
    """REP 117: NaN, not +Inf."""
    for message in (cloud(np.full((2, 3), np.nan)), cloud(room()[:0]), cloud(np.zeros((5, 3)))):
        assert np.isnan(scan_of(message, select=select).ranges).all()


def test_unknown_tf_is_told_of() -> None:
    of = settings()
    encoder = LinkedEncoder(VirtualScanEncoder(of.requested, FanCache(lambda frame, header: None)))
    encoder.derive(cloud(room(), '/velodyne'), of)
    assert list(encoder.warnings) == ["tf knows no transform from 'velodyne' to 'base_link': mount_height, mount_roll "
                                      'and mount_pitch are used']


def test_a_cloud_in_utm_is_level_where_tf_knows_its_frame() -> None:
    utm = np.array([412345.125, 5401234.5, 312.0625])
    exact = (room() + utm).astype('<f8')
    message = PointCloud2(height=1, width=len(exact), point_step=24, row_step=exact.nbytes, data=exact.tobytes(),
                          fields=[PointField(name, 8 * k, PointField.FLOAT64, 1) for k, name in enumerate('xyz')])
    scan = scan_of(message, FanCache(lambda frame, header: (np.eye(3), np.array([0, 0, MOUNT]) - utm)))
    assert scan.ranges[AHEAD] == pytest.approx(5.0, abs=0.02)
