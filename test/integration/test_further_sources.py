#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Clouds with rgb and other fields, and map_msgs/OccupancyGridUpdate in and out, at 0 and 20 % loss."""
import pathlib
import sys
import threading
import unittest
from typing import Any, List

import numpy as np
import rospy
import rostest
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import PointCloud2, PointField

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import wait_for

from smokebot_udp.streams.grid.map_updates import updated

OPERATORS = '/loss0', '/loss20'
COUNT = 3000
"""Points of a cloud: the i-th has x = i / 100 m, and fields that depend on i."""
POINT: Any = np.dtype({'names': ['x', 'y', 'z', 'rgb', 'ring', 'time'],
                       'formats': ['<f4', '<f4', '<f4', '<u4', '<u2', '<f8'], 'offsets': [0, 4, 8, 16, 20, 24],
                       'itemsize': 32})
TYPES = {'x': 7, 'y': 7, 'z': 7, 'rgb': 7, 'ring': 4, 'time': 8}
TIMEOUT = 60.0
"""[s]"""


def colours(index: Any) -> Any:
    return (index * 5003 % (1 << 24)).astype(np.uint32) | np.uint32(0xff000000)


def cloud() -> PointCloud2:
    index = np.arange(COUNT)
    points = np.zeros(COUNT, POINT)
    points['x'], points['y'], points['z'] = index / 100, 1.0, -1.0
    points['rgb'], points['ring'], points['time'] = colours(index), index % 16, 0.1
    message = PointCloud2(
        height=30, width=COUNT // 30, point_step=32, row_step=32 * COUNT // 30, data=points.tobytes(),
        fields=[PointField(name, POINT.fields[name][1], datatype, 1) for name, datatype in TYPES.items()])
    message.header.stamp, message.header.frame_id = rospy.Time.now(), 'depth'
    return message


def costmap(cells: Any) -> OccupancyGrid:
    message = OccupancyGrid(data=cells.ravel().tolist())
    message.header.stamp, message.header.frame_id = rospy.Time.now(), 'map'
    message.info.resolution, (message.info.height, message.info.width) = 0.05, cells.shape
    message.info.origin.orientation.w = 1.0
    return message


class Reader:
    """Puts updates into maps, as rviz does."""

    def __init__(self, topic: str) -> None:
        self.maps = 0
        self.updates: List[Any] = []
        self.map: Any = None
        self._lock = threading.Lock()
        self._subscribers = [rospy.Subscriber(topic, OccupancyGrid, self._take),
                             rospy.Subscriber(topic + '_updates', OccupancyGridUpdate, self._update)]

    def _take(self, message: Any) -> None:
        with self._lock:
            self.map = message
            self.maps += 1

    def _update(self, message: Any) -> None:
        with self._lock:
            self.updates.append(message)
            if self.map is not None:
                self.map = updated(self.map, message)

    def shows(self, cells: Any) -> bool:
        with self._lock:
            return self.map is not None and np.array_equal(np.asarray(self.map.data), cells.ravel())

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()


class FurtherSources(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('further_sources')
        cls.clouds = rospy.Publisher('/depth/points', PointCloud2, queue_size=2)
        cls.maps = rospy.Publisher('/costmap', OccupancyGrid, queue_size=2, latch=True)
        cls.updates = rospy.Publisher('/costmap_updates', OccupancyGridUpdate, queue_size=10)
        for publisher in cls.clouds, cls.maps, cls.updates:
            wait_for(publisher.get_num_connections, TIMEOUT, 'robot_sender')

    def test_a_cloud_with_colours_crosses(self) -> None:
        shown: Any = {where: [] for where in OPERATORS}
        for where, found in shown.items():
            self.addCleanup(rospy.Subscriber(where + '/operator/depth/points', PointCloud2, found.append).unregister)

        def enough() -> bool:
            """Whether a cloud came whole: a datagram that a busy machine delays is not waited for."""
            self.clouds.publish(cloud())
            return len(shown['/loss20']) > 3 and any(message.width == COUNT for message in list(shown['/loss0']))
        wait_for(enough, TIMEOUT, 'clouds')
        counts = {where: [self.check(message) for message in list(found)] for where, found in shown.items()}
        self.assertEqual(max(counts['/loss0']), COUNT)
        self.assertGreater(max(counts['/loss20']), COUNT // 2)

    def check(self, message: Any) -> int:
        """Every point has the fields of the place where it is; the number of points."""
        self.assertEqual([(field.name, field.datatype) for field in message.fields], [
            (name, TYPES[name]) for name in ('x', 'y', 'z', 'rgb', 'ring')])
        dtype: Any = [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('rgb', '<u4'), ('ring', '<u2')]
        points = np.frombuffer(message.data, dtype)
        index = np.rint(points['x'] * 100).astype(int)
        self.assertEqual(len(np.unique(index)), len(index))
        np.testing.assert_allclose(points['x'], index / 100, rtol=0, atol=0.0011)
        np.testing.assert_array_equal(points['rgb'], colours(index))
        np.testing.assert_array_equal(points['ring'], index % 16)
        return len(points)

    def test_updates_of_a_costmap_cross_as_updates(self) -> None:
        cells = np.random.RandomState(1).randint(-1, 101, (150, 200)).astype(np.int8)
        self.maps.publish(costmap(cells))
        for where in OPERATORS:     # a new subscriber gets the whole map, each time
            wait_for(lambda topic=where + '/operator/costmap': self.is_shown(topic, cells), TIMEOUT, 'the map')
        readers = {where: Reader(where + '/operator/costmap') for where in OPERATORS}
        for reader in readers.values():
            self.addCleanup(reader.close)
            wait_for(lambda one=reader: one.shows(cells) and one.updates, TIMEOUT, 'map and updates')
        for place in ((10, 20), (100, 40)):
            cells = self.change(cells, *place)
            for where, reader in readers.items():
                wait_for(lambda one=reader, now=cells: one.shows(now), TIMEOUT, 'the change at %s' % where)
        for reader in readers.values():
            self.assertEqual(reader.maps, 1)
            whole, *parts = reader.updates
            self.assertEqual((whole.width, whole.height), (200, 150))
            # how large they are depends on the link: an overview of the map may come before the tiles
            self.assertTrue(parts)
        larger = np.zeros((160, 200), np.int8)
        self.maps.publish(costmap(larger))
        for reader in readers.values():
            wait_for(lambda one=reader: one.shows(larger), TIMEOUT, 'the map of another size')
            self.assertGreater(reader.maps, 1)
        changed = self.change(larger, 10, 20)
        for where, reader in readers.items():
            wait_for(lambda one=reader: one.shows(changed), TIMEOUT, 'the change of the larger map')
            reader.close()      # a subscriber beside it would share its connection
            wait_for(lambda topic=where + '/operator/costmap': self.is_shown(topic, changed), TIMEOUT, 'it, late')

    def change(self, cells: Any, column: int, row: int) -> Any:
        """The cells after an update of 30 x 12 cells, published once."""
        patch = np.random.RandomState(row).randint(-1, 101, (12, 30)).astype(np.int8)
        message = OccupancyGridUpdate(x=column, y=row, width=30, height=12, data=patch.ravel().tolist())
        message.header.stamp, message.header.frame_id = rospy.Time.now(), 'map'
        self.updates.publish(message)
        changed = cells.copy()
        changed[row:row + 12, column:column + 30] = patch
        return changed

    @staticmethod
    def is_shown(topic: str, cells: Any) -> bool:
        """Whether a new subscriber gets these cells."""
        try:
            message = rospy.wait_for_message(topic, OccupancyGrid, 5.0)
        except rospy.ROSException:
            return False
        return np.array_equal(np.asarray(message.data), cells.ravel())


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'further_sources', FurtherSources)
