#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Maps through robot_sender and operator_receiver: real nodes, real sockets, real master."""
import pathlib
import sys
from typing import Any

import numpy as np
import rospy
import rostest
from nav_msgs.msg import OccupancyGrid

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from streams_case import LOSSES, StreamsCase
from waiting import Collector, give_time, wait_for

from smokebot_udp import udpros
from smokebot_udp.msg import GridSegment

ROUNDS = 10
REPEAT_RATE = 4.0     # in world_streams.yaml [Hz]
MAX_WAIT = 0.5 + 4.5    # the stream's, and for what a busy machine is late [s]


def rooms(height, width) -> Any:
    """Unknown outside, free rooms inside, walls two cells thick."""
    cells = np.full((height, width), -1, np.int8)
    cells[20:-20, 20:-20] = 0
    for row in range(20, height - 20, 80):
        cells[row:row + 2, 20:-20] = 100
    for column in range(20, width - 20, 120):
        cells[20:-20, column:column + 2] = 100
    return cells


def grid(cells, resolution=0.05, origin=(-3.0, 2.0)) -> Any:
    message = OccupancyGrid(data=cells.ravel().tolist())
    message.header.stamp, message.header.frame_id = rospy.Time.now(), 'map'
    message.info.map_load_time = rospy.Time(17, 5)
    message.info.resolution, message.info.height, message.info.width = resolution, cells.shape[0], cells.shape[1]
    message.info.origin.position.x, message.info.origin.position.y = origin
    message.info.origin.orientation.w = 1.0
    return message


def cells_of(message) -> Any:
    return np.array(message.data, np.int8).reshape(message.info.height, message.info.width)


class MapStreams(StreamsCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('map_streams')
        cls.source = rospy.Publisher('/map', OccupancyGrid, queue_size=2)
        cls.out = {loss: Collector(where + '/map', OccupancyGrid) for loss, where in LOSSES.items()}
        cls.listen('map')
        wait_for(cls.source.get_num_connections, what='robot_sender')

    def shown(self, message) -> Any:
        return wait_for(lambda: self.out[0].messages.get(message.header.stamp), 10, 'the map')

    def shown_exactly(self, message, cells) -> Any:
        """The map, once it is this one: where a segment is late, only its next round completes it."""
        def exact() -> Any:
            got = self.out[0].messages.get(message.header.stamp)
            return got if got is not None and np.array_equal(cells_of(got), cells) else None
        return wait_for(exact, 10, 'the exact map')

    def test_a_map_is_exact_and_may_grow(self) -> None:
        for cells, origin in (
                (rooms(100, 150), (-3.0, 2.0)), (rooms(300, 500), (-8.0, -4.0)), (rooms(1, 1), (0.0, 0.0))):
            message = grid(cells, origin=origin)
            self.source.publish(message)
            got = self.shown_exactly(message, cells)
            self.assertEqual((got.info.origin, got.info.map_load_time, got.header.frame_id),
                             (message.info.origin, message.info.map_load_time, 'map'))
            self.assertAlmostEqual(got.info.resolution, 0.05, places=6)

    def test_a_large_map_is_reduced_by_its_highest_cells(self) -> None:
        cells = rooms(999, 1201)
        message = grid(cells)
        self.source.publish(message)
        padded = np.pad(cells, ((0, 1), (0, 1)), mode='edge')
        got = self.shown_exactly(message, padded.reshape(500, 2, 601, 2).max(axis=(1, 3)))
        self.assertEqual(got.info.origin, message.info.origin)
        self.assertAlmostEqual(got.info.resolution, 0.1, places=6)

    def test_every_wall_stands_after_some_rounds(self) -> None:
        cells = rooms(400, 600)
        message = grid(cells, origin=(1.0, 1.0))
        rounds = []
        counter = udpros.Subscriber('/smokebot_udp/map/segments', GridSegment, transport='udp', batch_callback=(
            lambda records, mask: rounds.extend(records['info']['width'][mask & (records['index'] == 0)].tolist())))
        self.addCleanup(counter.unregister)
        wait_for(counter.get_num_connections, what='robot_sender')
        self.source.publish(message)
        self.shown(message)
        wait_for(lambda: rounds.count(600) >= ROUNDS, 60, '%d rounds' % ROUNDS)
        # Of a cell all ten rounds lose one in a thousand; its nearest stands in for it
        walls = [(slice(row, row + 2), slice(20, -20)) for row in range(20, 380, 80)]
        walls += [(slice(20, -20), slice(column, column + 2)) for column in range(20, 580, 120)]

        def is_complete() -> bool:
            shown = self.out[50].messages.get(message.header.stamp)
            got = cells_of(shown) if shown else np.zeros_like(cells)
            return all((got[wall] == 100).mean() > 0.98 for wall in walls) and (got != cells).mean() < 0.01
        # the receiver waits for more before it shows what the last round brought
        wait_for(is_complete, MAX_WAIT, 'every wall')

    def test_an_operator_who_comes_late_gets_the_map(self) -> None:
        message = grid(rooms(200, 200), origin=(5.0, 5.0))
        self.source.publish(message)
        self.shown(message)
        late = Collector('/operator/map', OccupancyGrid)     # latched at the operator's side
        wait_for(lambda: message.header.stamp in late.messages, 5, 'the latched map')

    def test_an_unchanged_map_is_shown_once(self) -> None:
        first, again = (grid(rooms(150, 150), origin=(9.0, 9.0)) for _ in range(2))
        self.source.publish(first)
        self.shown(first)
        again.header.stamp += rospy.Duration(1)
        shown = len(self.out[0].messages)
        self.source.publish(again)
        give_time(3 / REPEAT_RATE)    # nothing may come
        self.assertEqual(len(self.out[0].messages), shown)

    def test_bad_maps_are_told_of_and_the_next_good_one_comes(self) -> None:
        good = rooms(50, 60)
        for spoil, words in ((lambda m: setattr(m, 'data', m.data[:-1]), 'data has 2999 cells'),
                             (lambda m: setattr(m.info, 'resolution', 0.0), 'resolution is 0.0'),
                             (lambda m: setattr(m.info, 'resolution', float('nan')), 'resolution is nan'),
                             (lambda m: setattr(m.info, 'width', 0), 'width is 0'),
                             (lambda m: setattr(m.info, 'height', 5000), 'height is 5000'),
                             (lambda m: setattr(m.info.origin.position, 'x', float('inf')), 'origin.x is inf')):
            message = grid(good)
            spoil(message)
            self.refused(self.source, message, 'map', words)
        message = grid(good, origin=(7.0, 7.0))
        self.source.publish(message)
        self.shown_exactly(message, good)

    def test_forged_segments_crash_nothing(self) -> None:
        random = np.random.RandomState(3)

        def forge() -> Any:
            segment = GridSegment(depth=random.randint(12), index=random.randint(65536), count=random.randint(256),
                                  data=random.randint(-128, 128, random.randint(1300)).tolist())
            segment.header.stamp = rospy.Time.now() - rospy.Duration(random.randint(2) * 100)
            segment.info.width, segment.info.height = random.choice([0, 1, 600, 4096, 2 ** 31], 2)
            segment.info.resolution = random.choice([0.0, 0.05, float('nan'), float('inf'), -1.0])
            return segment
        self.flood('map', GridSegment, forge)
        message = grid(rooms(120, 160), origin=(-1.0, -1.0))
        self.source.publish(message)
        self.shown_exactly(message, cells_of(message))


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'map_streams', MapStreams)
