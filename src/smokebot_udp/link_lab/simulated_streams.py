# SPDX-License-Identifier: BSD-3-Clause
"""What a robot's streams put on a simulated link: sizes and times as the real ones have them, no pixels."""
from dataclasses import dataclass
from typing import Any, Callable, Dict

from ..congestion.allocation import BUDGET, Allocator, Demand, datagram_size
from ..congestion.operating_points import cloud_levels, image_levels, map_levels, rate_levels
from .simulated import FULL

HEADERS = 110
"""Of a datagram: IP, UDP, UDPROS, and what tells a segment's place [byte]."""

ALLOCATIONS_APART = 0.1
"""[s]"""


@dataclass
class Stream:
    """One stream that can be turned down."""
    demand: Demand
    content: Callable[[Dict[str, Any]], float]
    """f(level's settings) -> bytes of a message, headers not included."""
    rate: str = 'rate'
    """Which setting says how often it sends."""


def picture(size, rate=10.0, weight=4.0, floor=0.0, taste=0.75):
    """Pictures of so many bytes."""
    datagrams = -(-size // (FULL - HEADERS))
    levels = image_levels(rate, datagrams, 1, FULL, taste)
    return Stream(Demand(levels, weight, floor),
                  lambda settings: size * (settings['max_subimages'] or datagrams) / datagrams)


def cloud(size, rate=10.0, leaf_size=0.1, weight=1.0, floor=0.0):
    """Clouds of so many bytes at the finest."""
    return Stream(Demand(cloud_levels(rate, leaf_size, size), weight, floor),
                  lambda settings: size * (leaf_size / settings['leaf_size']) ** 2)


def grid(segments, repeat_rate=0.2, weight=0.5, floor=0.0):
    """Maps in rounds."""
    return Stream(Demand(map_levels(repeat_rate, segments, FULL), weight, floor),
                  lambda settings: settings['max_segments'] * (FULL - HEADERS), 'repeat_rate')


def scan(size, rate=10.0, weight=1.0, floor=0.0):
    """Scans that come whole or not at all."""
    return Stream(Demand(rate_levels(rate, size), weight, floor), lambda settings: size)


class Streams:
    """The load of a robot: its streams, and what is protected.

    :param streams: {name: Stream}
    :param protected: {name: (rate [Hz], size [byte])}
    """

    def __init__(self, streams, protected):
        self.streams, self.protected = dict(streams), protected
        self._allocator = Allocator()
        self.grants = {}
        self.granted = []
        """(when, {name: Grant}) whenever something changed."""
        self._due = dict.fromkeys(streams, 0.0)     # when a stream may send again [s]
        self._frames = dict.fromkeys(streams, 0)

    def __call__(self, robot):
        """Begin, on a simulated.Robot."""
        self._robot = robot
        self._allocate()
        for number, name in enumerate(self.streams):
            robot.events.at(0.013 * number, self._send, name)
        for number, (name, (rate, size)) in enumerate(self.protected.items()):
            robot.events.at(0.007 * number, self._publish, name, 1 / rate, size)

    def change_focus(self, **weights):
        """Other weights from now on: {name: weight}."""
        for name, weight in weights.items():
            self.streams[name].demand.weight = weight
        self._allocator.forget()

    def _allocate(self):
        robot = self._robot
        demands = {name: stream.demand for name, stream in self.streams.items()}
        protected = sum(rate * size for rate, size in self.protected.values())
        robot.wanted = protected + sum(demand.levels[-1].cost for demand in demands.values())
        grants = self._allocator.allocate(
            BUDGET * robot.estimator.link.capacity, demands, protected, robot.robot_time)
        if {name: grant.level for name, grant in grants.items()} != {
                name: grant.level for name, grant in self.grants.items()}:
            self.granted.append((robot.events.now, grants))
        self.grants = grants
        for name, grant in grants.items():
            robot.pace.set_share(name, max(grant.share, 1.0))
        robot.events.at(robot.events.now + ALLOCATIONS_APART, self._allocate)

    def _send(self, name):
        robot, stream, grant = self._robot, self.streams[name], self.grants[name]
        period = ALLOCATIONS_APART      # until it may send again
        if grant.level is not None:
            period = 1 / grant.settings[stream.rate]
            size = datagram_size(robot.estimator.link.capacity, FULL)
            count = max(1, round(stream.content(grant.settings) / (size - HEADERS)))
            self._frames[name] += 1
            robot.put(name, (self._frames[name], count), [(count, size)])
        robot.events.at(robot.events.now + period, self._send, name)

    def _publish(self, name, period, size):
        self._robot.publish(name, self._robot.events.now, size)
        self._robot.events.at(self._robot.events.now + period, self._publish, name, period, size)


def navigation():
    """A robot that drives by what it sees."""
    return Streams({
        'thermal': picture(320 * 240 * 2, weight=4.0, floor=100e3 / 8),
        'camera': picture(320 * 240 * 3, rate=5.0, weight=1.0),
        'lidar': cloud(60000, rate=5.0, leaf_size=0.2),
        'obstacle_scan': scan(1600, weight=2.0, floor=60e3 / 8),
        'map': grid(60),
    }, {'tf': (20.0, 220), 'odom': (10.0, 800), 'gas': (2.0, 80), 'battery': (1.0, 250)})
