#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Maps in tiles through robot_sender and operator_receiver at 20 % loss: real nodes, real sockets, real master."""
import importlib.util
import os
import pathlib
import signal
import sys
import time
import unittest
from typing import Any, Tuple

import numpy as np
import rosgraph
import rospy
import rostest
from nav_msgs.msg import OccupancyGrid

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, errors_logged, give_time, pid_at, undisturbed, wait_for

from smokebot_udp import udpros, version
from smokebot_udp.congestion.estimator import REPORT_INTERVAL
from smokebot_udp.msg import LinkReport, MapTile
from smokebot_udp.nodes.link_reporter import TOPIC

LOADED = 300.0
"""The compiled codec is loaded within this time, compiled first where it is not yet [s]."""

TIMEOUT = 30.0
"""Within this a map is complete, also on a busy machine [s]."""

ROBOT, OPERATOR = '/robot_sender', '/loss20/operator_receiver'
RESOLUTION = float(np.float32(0.05))


def building(height: int, width: int, seed: int = 0, clutter: float = 0.005) -> Any:
    """Unknown outside; free rooms, walls, and clutter."""
    random = np.random.RandomState(seed)
    cells = np.full((height, width), -1, np.int8)
    cells[20:-20, 20:-20] = 0
    cells[20:-20:80, 20:-20] = cells[21:-20:80, 20:-20] = 100
    cells[20:-20, 20:-20:120] = cells[20:-20, 21:-20:120] = 100
    rows, columns = (random.randint(25, size - 25, int(height * width * clutter)) for size in (height, width))
    cells[rows, columns] = 100
    return cells


def grid(cells: Any, origin: Tuple[float, float] = (-3.0, 2.0)) -> Any:
    message = OccupancyGrid(data=cells.ravel().tolist())
    message.header.stamp, message.header.frame_id = rospy.Time.now(), 'map'
    message.info.resolution, message.info.height, message.info.width = RESOLUTION, *cells.shape
    message.info.origin.position.x, message.info.origin.position.y = origin
    message.info.origin.orientation.w = 1.0
    return message


def cells_of(message: Any) -> Any:
    return np.array(message.data, np.int8).reshape(message.info.height, message.info.width)


def node_pid(name: str) -> int:
    try:
        return pid_at(rosgraph.Master('/tile_streams').lookupNode(name))
    except rosgraph.MasterError:
        return 0


@unittest.skipIf(importlib.util.find_spec('numba') is None, 'maps in tiles need numba: sudo apt install python3-numba')
class TileStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('tile_streams')
        cls.errors = errors_logged()
        cls.source = rospy.Publisher('/map', OccupancyGrid, queue_size=2, latch=True)
        cls.out = Collector('/loss20/operator/map', OccupancyGrid)
        cls.ages = Collector('/loss20/operator/map/age', OccupancyGrid)
        cls.arrived = np.zeros(2, int)      # datagrams and bytes of tiles that the operator received
        cls.counted = np.zeros(2, int)      # of the present connection
        cls.reported = 0
        cls.reports = udpros.Subscriber(TOPIC, LinkReport, cls.count)
        wait_for(cls.source.get_num_connections, what='robot_sender')
        cls.cells = building(600, 800)
        cls.source.publish(grid(cls.cells))
        wait_for(lambda: cls.shows(cls.cells), LOADED, 'the first map')

    @classmethod
    def count(cls, report: Any) -> None:
        cls.reported += 1
        for stream in report.streams:
            if stream.name == 'map/tiles':
                now = np.array([stream.received, stream.bytes])
                cls.arrived = cls.arrived + (now - cls.counted if (now >= cls.counted).all() else now)
                cls.counted = now

    @classmethod
    def shows(cls, cells: Any, origin: Tuple[float, float] = (-3.0, 2.0)) -> bool:
        """Whether the operator's newest map is this one."""
        message = cls.out.newest()
        at = message and message.info.origin.position
        return bool(message and np.array_equal(cells_of(message), cells) and np.allclose((at.x, at.y), origin))

    def publish(self, cells: Any, origin: Tuple[float, float] = (-3.0, 2.0)) -> float:
        """Publish a map, which is shown within TIMEOUT; how long it took [s]."""
        message = grid(cells, origin)
        begun = time.monotonic()
        self.source.publish(message)
        wait_for(lambda: self.shows(cells, origin), TIMEOUT, 'the map')
        type(self).cells = cells
        return time.monotonic() - begun

    def setUp(self) -> None:
        self.publish(building(600, 800))    # where it is there already, it is not shown anew

    def quiet(self) -> None:
        """Wait until nothing but statements about the map arrives, as an operator says that is not late itself."""
        def still() -> bool:
            before, reported = self.arrived, self.reported
            give_time(2.0)
            return bool(self.arrived[0] - before[0] <= 3) and self.reported - reported >= 0.75 * 2.0 / REPORT_INTERVAL
        wait_for(still, TIMEOUT, 'a map that is held')

    def test_a_large_map_is_complete_and_exact(self) -> None:
        cells = building(945, 1165, seed=1)
        print('945 x 1165 cells: complete after %.1f s' % self.publish(cells, (-20.0, -30.0)), file=sys.stderr)
        message = self.out.newest()
        self.assertEqual((message.header.frame_id, message.info.resolution), ('map', RESOLUTION))

    @undisturbed()
    def test_small_changes_are_shown_soon(self) -> None:
        cells, random = building(600, 800), np.random.RandomState(2)
        times = []
        for value in range(1, 21):
            cells = cells.copy()
            row, column = random.randint(30, 550), random.randint(30, 750)
            cells[row:row + 20, column:column + 20] = value
            times.append(self.publish(cells))
            give_time(0.2)      # between two changes
        print('a change of 20 x 20 cells is shown after %.2f s, p95 %.2f s' % (
            np.median(times), np.percentile(times, 95)), file=sys.stderr)
        self.assertLess(np.median(times), 1.0)

    @undisturbed()      # tiles that are late are sent again
    def test_a_growing_map_whose_origin_moves_keeps_its_tiles(self) -> None:
        rich = building(600, 800, 7, 0.05)      # its cells take more than the heads of its datagrams
        self.publish(rich)
        self.quiet()
        before = self.arrived[1]
        whole = np.full((640, 900), -1, np.int8)
        whole[40:, 100:] = rich
        whole[:200, :90] = 0
        self.publish(whole, (-8.0, 0.0))
        grown = self.arrived[1] - before
        self.publish(building(600, 800, 8, 0.05))
        self.quiet()
        # what a map of this size takes from the beginning
        self.assertLess(grown, 0.8 * (self.arrived[1] - before - grown))

    @undisturbed()
    def test_a_map_that_is_held_is_not_sent_again(self) -> None:
        self.quiet()
        before = self.arrived
        self.source.publish(grid(building(600, 800)))      # its content is the same
        give_time(6.0)
        datagrams, size = self.arrived - before
        self.assertLessEqual(datagrams, 12)
        self.assertLess(size / 6.0, 1000.0)

    def restart(self, node: str) -> None:
        before = wait_for(lambda: node_pid(node), what=node)
        os.kill(before, signal.SIGKILL)
        wait_for(lambda: node_pid(node) not in (0, before), 60, '%s once more' % node)

    def test_an_operator_who_starts_again_gets_the_map(self) -> None:
        self.out.clear()
        self.restart(OPERATOR)
        wait_for(lambda: self.shows(self.cells), 60, 'the map')

    def test_a_robot_that_starts_again_sends_the_map_again(self) -> None:
        self.quiet()
        before = self.arrived[0]
        self.restart(ROBOT)
        wait_for(lambda: self.arrived[0] > before + 5, 60, 'tiles of another session')
        self.quiet()
        cells = self.cells.copy()
        cells[100:120, 100:120] = 77
        self.publish(cells)

    def test_ages_grow_while_the_robots_side_is_silent(self) -> None:
        def oldest() -> int:
            message = self.ages.newest()
            assert message is not None
            return max(message.data)
        self.quiet()
        wait_for(self.ages.newest, TIMEOUT, 'ages')
        wait_for(lambda: oldest() <= 3, TIMEOUT, 'ages of a map that is confirmed')
        pid = wait_for(lambda: node_pid(ROBOT), what=ROBOT)
        os.kill(pid, signal.SIGSTOP)
        try:
            wait_for(lambda: oldest() >= 8, TIMEOUT, 'ages of a map that nothing confirms')
        finally:
            os.kill(pid, signal.SIGCONT)
        wait_for(lambda: oldest() <= 3, TIMEOUT, 'ages of a map that is confirmed again')

    def test_forged_segments_begin_no_map_and_do_not_stay(self) -> None:
        self.quiet()
        random = np.random.RandomState(3)
        shown = len(self.out.messages)
        hostile = udpros.Publisher('/smokebot_udp/map/tiles', MapTile, queue_size=50, headers=version.headers())
        self.addCleanup(hostile.unregister)
        wait_for(lambda: hostile.get_num_connections() > 0, what='the operator')
        for number in range(300):
            width, height = (int(side) for side in random.choice([0, 1, 600, 4096, 65536], 2))
            segment = MapTile(corner=random.randint(-100, 100, 2).tolist(), session=number,
                              revision=int(random.randint(1 << 31)), shift=int(random.randint(10)),
                              place=random.randint(-100, 100, 2).tolist(), size=random.randint(0, 99, 2).tolist(),
                              data=bytes(random.randint(0, 256, random.randint(50)).tolist()))
            segment.info.width, segment.info.height = width, height
            segment.info.resolution = float(random.choice([0.0, 0.05, np.nan, np.inf, -1.0]))
            hostile.publish(segment)
        give_time(1.0)
        self.assertEqual(len(self.out.messages), shown)
        cells = self.cells.copy()
        cells[50:70, 50:70] = 44
        self.publish(cells)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'tile_streams', TileStreams)
