# SPDX-License-Identifier: BSD-3-Clause
"""What a robot's streams send over a simulated link: the real ones' sizes and times, without content."""
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from smokebot_udp.congestion.controller import Demand, Plan
from smokebot_udp.congestion.operating_points import cloud_points, image_points, map_points, rate_points

from .simulated_air import FULL, Load, Robot

HEADERS = 110
"""Size of a datagram's headers: IP, UDP, UDPROS, and a segment's place in its image [byte]."""

PAUSE_INTERVAL = 0.1
"""A stream that has to pause looks for a grant this often [s]."""

MIN_PROTECTED_RATE = 1.0
"""A protected stream is not decimated below this, as relays are not [Hz]."""


@dataclass
class Stream:
    """One stream that can be turned down."""
    demand: Demand
    content: Callable[[Mapping[str, Any]], float]
    """f(settings) -> bytes of a message, headers not included."""
    rate: str = 'rate'
    """The setting that is its rate."""


def image(size: int, rate: float = 10.0, weight: float = 4.0, min_bitrate: float = 0.0,
          degradation_preference: float = 0.75) -> Stream:
    """Images of this size [byte]."""
    datagrams = -(-size // (FULL - HEADERS))

    def refine(settings: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        count = (settings['max_subimages'] or datagrams) + int(spare / (settings['rate'] * FULL))
        return {**settings, 'max_subimages': 0 if count >= datagrams else count}

    points = image_points(rate, datagrams, 1, FULL, degradation_preference)
    return Stream(Demand(points, weight, min_bitrate, rate, refine),
                  lambda settings: size * (settings['max_subimages'] or datagrams) / datagrams)


def cloud(size: int, rate: float = 10.0, leaf_size: float = 0.1, weight: float = 1.0) -> Stream:
    """Clouds of this size at the finest leaf size [byte, m]."""
    return Stream(Demand(cloud_points(rate, leaf_size, size), weight, rate=rate),
                  lambda settings: size * (leaf_size / settings['leaf_size']) ** 2)


def grid(segments: int, repeat_rate: float = 0.2, weight: float = 0.5) -> Stream:
    """Maps in refresh cycles."""
    return Stream(Demand(map_points(repeat_rate, segments, FULL), weight),
                  lambda settings: settings['max_segments'] * (FULL - HEADERS), 'repeat_rate')


def scan(size: int, rate: float = 10.0, weight: float = 1.0, min_bitrate: float = 0.0) -> Stream:
    """Scans that are sent completely or not at all."""
    return Stream(Demand(rate_points(rate, size), weight, min_bitrate, rate), lambda settings: size)


def long_relay(size: int, rate: float = 10.0, weight: float = 1.0) -> Stream:
    """Messages of many datagrams that are useless without all of them."""
    return Stream(Demand(rate_points(rate, size), weight, rate=rate, whole=True), lambda settings: size)


class Streams(Load):
    """The load of a robot: its streams, and what is protected.

    :param streams: {name: Stream}
    :param protected: {name: (rate [Hz], size [byte])}
    """

    def __init__(self, streams: Mapping[str, Stream], protected: Mapping[str, Tuple[float, int]]) -> None:
        self.streams, self.protected = dict(streams), dict(protected)
        self.granted: List[Tuple[float, Dict[str, Optional[Dict[str, Any]]]]] = []
        """(when, grants) whenever they changed"""
        self.published: List[float] = []
        """When each protected message was sent."""
        self._frames = dict.fromkeys(streams, 0)

    def start(self, robot: Robot) -> None:
        self._robot = robot
        self.apply(robot.plan)
        for number, name in enumerate(self.streams):
            robot.events.at(0.013 * number, self._send, name)
        for number, name in enumerate(self.protected):
            robot.events.at(0.007 * number, self._publish, name)

    def demands(self) -> Dict[str, Demand]:
        return {name: stream.demand for name, stream in self.streams.items()}

    def apply(self, plan: Plan) -> None:
        if not self.granted or plan.grants != self.granted[-1][1]:
            self.granted.append((self._robot.events.now, plan.grants))
        for name, share in plan.shares.items():
            self._robot.scheduler.set_share(name, share)

    def change_focus(self, **weights: float) -> None:
        """Apply other weights from now on: {name: weight}."""
        for name, weight in weights.items():
            self.streams[name].demand.weight = weight
        self._robot.controller.forget()

    def _send(self, name: str) -> None:
        robot, stream = self._robot, self.streams[name]
        grant, period = robot.plan.grants[name], PAUSE_INTERVAL
        if grant is not None:
            settings = {**stream.demand.points[-1].settings, **grant}
            period, size = 1 / settings[stream.rate], robot.plan.datagram_size
            count = max(1, round(stream.content(settings) / (size - HEADERS)))
            self._frames[name] += 1
            robot.put(name, (self._frames[name], count), [(count, size)])
        robot.events.at(robot.events.now + period, self._send, name)

    def _publish(self, name: str) -> None:
        robot, (rate, size) = self._robot, self.protected[name]
        self.published.append(robot.events.now)
        robot.publish(name, robot.events.now, size)
        rate = max(robot.plan.decimation * rate, min(MIN_PROTECTED_RATE, rate))
        robot.events.at(robot.events.now + 1 / rate, self._publish, name)


def navigation() -> Streams:
    """A robot that drives by what it sees."""
    return Streams({
        'thermal': image(320 * 240 * 2, weight=4.0, min_bitrate=100e3 / 8),
        'camera': image(320 * 240 * 3, rate=5.0, weight=1.0),
        'lidar': cloud(60000, rate=5.0, leaf_size=0.2),
        'obstacle_scan': scan(1600, weight=2.0, min_bitrate=60e3 / 8),
        'map': grid(60),
    }, {'tf': (20.0, 220), 'odom': (10.0, 800), 'gas': (2.0, 80), 'battery': (1.0, 250)})
