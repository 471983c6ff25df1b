# SPDX-License-Identifier: BSD-3-Clause
"""Frames by their names: a slash at the beginning makes no other frame, wherever two are compared or looked up."""
from typing import Any, List

import numpy as np
import pytest
import rospy
import tf2_ros
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from nav_msgs.msg import MapMetaData, OccupancyGrid
from sensor_msgs.msg import PointCloud2, PointField, Range
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from smokebot_udp.codecs.display.driven_path import DrivenPath
from smokebot_udp.codecs.perception.ground import GroundFinder
from smokebot_udp.codecs.tiles.lattice import Lattice
from smokebot_udp.frame_names import frame_name, unknown_transform
from smokebot_udp.nodes.level_frame import TransformLookup
from smokebot_udp.streams.grid.map_updates import UPDATE, same_place, updated
from smokebot_udp.streams.relay.contents import Contents
from smokebot_udp.streams.virtual_scan import fans


class Buffer(tf2_ros.BufferCore):
    """tf2's own, without a node."""
    lookup_transform = tf2_ros.BufferCore.lookup_transform_core


@pytest.mark.parametrize('frame_id, name', [('map', 'map'), ('/map', 'map'), ('//map', 'map'), ('', ''), ('/', ''),
                                            ('robot_0/map', 'robot_0/map'), ('/robot_0/map', 'robot_0/map')])
def test_a_name(frame_id: str, name: str) -> None:
    assert frame_name(frame_id) == name


def test_what_tf_does_not_know_is_named() -> None:
    assert unknown_transform('/velodyne', 'base_link', 'it is left out') == (
        "tf knows no transform from 'velodyne' to 'base_link': it is left out")


@pytest.mark.parametrize('frame', ['base_link', '/base_link'])
@pytest.mark.parametrize('frame_id', ['velodyne', '/velodyne'])
def test_tf_knows_frames_with_and_without_a_slash(monkeypatch: Any, frame: str, frame_id: str) -> None:
    buffer = Buffer()
    monkeypatch.setattr(tf2_ros, 'Buffer', lambda: buffer)
    monkeypatch.setattr(tf2_ros, 'TransformListener', lambda _: None)
    lookup = TransformLookup()
    buffer.set_transform(TransformStamped(Header(frame_id='base_link', stamp=rospy.Time(5)), 'velodyne', Transform(
        Vector3(1, 2, 3), Quaternion(0, 0, 0, 1))), 'test')
    found = lookup(frame, Header(frame_id=frame_id, stamp=rospy.Time(5)))
    assert found is not None and found[1].tolist() == [1, 2, 3] and np.array_equal(found[0], np.eye(3))
    assert lookup('map', Header(frame_id=frame_id)) is None
    assert lookup.pose([frame], Header(frame_id=frame_id, stamp=rospy.Time(5))) is not None


def test_an_update_is_of_its_map_whatever_slash_either_has() -> None:
    grid = OccupancyGrid(Header(frame_id='/map'), MapMetaData(width=2, height=1, resolution=0.1), [0, 0])
    update = UPDATE(header=Header(frame_id='map'), x=1, width=1, height=1, data=np.array([100], np.int8))
    changed = updated(grid, update)
    assert changed.data.tolist() == [0, 100] and changed.header.frame_id == '/map'
    assert same_place(grid, OccupancyGrid(Header(frame_id='map'), grid.info, [0, 0]))


SLASHED = 'map', '/map', 'map'


def test_the_parts_of_one_frame_replace_each_other() -> None:
    for class_, make in ((Range, lambda name: Range(header=Header(frame_id=name))),
                         (TFMessage, lambda name: TFMessage([TransformStamped(child_frame_id=name)]))):
        contents = Contents(class_)
        for name in SLASHED:
            contents.add(make(name), 'driver')
        assert len(contents.messages(1000)) == 1 and contents.replaced == 2


def test_maps_of_one_frame_lie_in_one_lattice() -> None:
    first, second = (Lattice.of(name, MapMetaData(resolution=0.05)) for name in ('map', '/map'))
    assert first.same(second) and first.to(Lattice.of('odom', MapMetaData(resolution=0.05))) is None


def test_the_driven_path_goes_on() -> None:
    path = DrivenPath()
    for number, name in enumerate(SLASHED):
        path.add(name, (float(number), 0.0, 0.0))
    assert len(path.positions) == 3


def test_the_ground_is_known_on_in_one_frame(monkeypatch: Any) -> None:
    made: List[float] = []

    def finder(height: float) -> GroundFinder:
        made.append(height)
        return GroundFinder(height)
    monkeypatch.setattr(fans, 'GroundFinder', finder)
    random, cache = np.random.RandomState(0), fans.FanCache()
    points = np.column_stack([*random.uniform(-5, 5, (2, 2000)), np.full(2000, -0.9)]).astype('<f4')
    values = {**dict.fromkeys(fans.FAN_SETTINGS, 0.0), 'base_frame': '', 'mount_height': 0.9, 'slope': 0.1,
              'range_max': 9.0}
    for name in SLASHED:
        found = cache.fan(PointCloud2(
            header=Header(frame_id=name), height=1, width=2000, point_step=12, row_step=points.nbytes,
            data=points.tobytes(), fields=[PointField(axis, 4 * at, PointField.FLOAT32, 1)
                                           for at, axis in enumerate('xyz')]), values)
        assert found.frame == name
    assert made == [0.9]
