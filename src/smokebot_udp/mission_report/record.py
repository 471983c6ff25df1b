# SPDX-License-Identifier: BSD-3-Clause
"""What the report keeps of the messages of both sides: times, stamps, and the states of the link and the robot."""
import array
import json
import math
from types import MappingProxyType
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from ..arrays import FloatArray

ROBOT, OPERATOR = SIDES = 'robot', 'operator'

LOAD_PERIOD = 0.25
"""How often a black box tells the load of its machine [s]."""

LEAST_STEP = 0.05
"""Shorter motions are taken for noise of the odometry [m]."""

Roles = Mapping[str, List[Tuple[str, str]]]
"""{topic: [(side, name of a stream that has it there), ...]}"""


class Stream(NamedTuple):
    """A stream, as the description of a bag says."""
    type: str
    to_robot: bool


class Description(NamedTuple):
    """What a bag says of itself."""
    side: str
    namespace: str
    streams: Dict[str, Stream]
    roles: Dict[str, List[Tuple[str, str]]]
    """See Roles."""


class State(NamedTuple):
    """A RobotStatus."""
    time: float
    """Its stamp [s]."""
    focus: str
    driver: str
    estop: bool
    streams: Dict[str, Tuple[bool, bool, float]]
    """{stream: (whether it is sent, whether it is paused, its maximum rate [Hz])}"""


class LinkState(NamedTuple):
    """A LinkStatus; its units."""
    time: float
    """Its stamp [s]."""
    rate: float
    sent: float
    capacity: float
    loss: float
    queue_delay: float
    round_trip: float
    by_path: Mapping[str, float] = MappingProxyType({})
    """{path: what is sent by it}, where there are two."""


class Track:
    """The messages of a stream on one side."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._times, self._stamps, self._files = array.array('d'), array.array('d'), array.array('H')

    def add(self, time: float, stamp: float, file: int) -> None:
        """A message.

        :param time: when it was recorded [s]
        :param stamp: NaN: it has none [s]
        :param file: number of its bag
        """
        self._times.append(time)
        self._stamps.append(stamp)
        self._files.append(file)

    def __len__(self) -> int:
        return len(self._times)

    def sorted(self) -> Tuple[FloatArray, FloatArray, FloatArray]:
        """(times, stamps, numbers of the bags), each of shape (messages,), by time."""
        times = np.array(self._times)
        order = np.argsort(times, kind='stable')
        return times[order], np.array(self._stamps)[order], np.array(self._files, float)[order]


class MissionRecord:
    """Collects messages. The order of bags, and of messages of different bags, does not matter."""

    def __init__(self) -> None:
        self.streams: Dict[str, Stream] = {}
        self.tracks: Dict[str, Dict[str, Track]] = {side: {} for side in SIDES}
        """{side: {stream: its messages}}"""
        self.spans: Dict[str, Tuple[float, float]] = {}
        """{side: (first, last message)}, by its clock [s]; without entry: it was not recorded."""
        self.links: Dict[str, Dict[float, LinkState]] = {side: {} for side in SIDES}
        self.states: Dict[str, Dict[float, State]] = {side: {} for side in SIDES}
        self.control: Dict[float, str] = {}
        """{time by the operator's clock: state of the operator's control, in words}"""
        self.images: Dict[Tuple[str, str], Dict[float, Tuple[float, int, str]]] = {}
        """{(side, stream): {stamp: (when it was recorded [s], number of the bag, topic)}} of images that the black box
        compressed after they had arrived."""
        self.loads: Dict[str, Dict[float, float]] = {side: {} for side in SIDES}
        """{side: {time by its clock: load of its machine, see nodes/machine_load.py}}"""
        self.offsets: Dict[float, float] = {}
        """{time by the operator's clock: the robot's clock minus the operator's} [s]"""
        self.ways: Dict[str, List[Tuple[float, float, float]]] = {side: [] for side in SIDES}
        """{side: [(time, x, y) of the odometry, ...]}, by the side's clock [s], [m]"""

    def describe(self, description: Description) -> None:
        """Take over the streams of a bag."""
        self.streams.update(description.streams)

    def add(self, side: str, time: float) -> None:
        """Some message that a side has recorded at a time, by its clock [s]."""
        first, last = self.spans.get(side, (time, time))
        self.spans[side] = min(first, time), max(last, time)

    def add_stream(self, side: str, name: str, topic: str, time: float, stamp: float, file: int) -> None:
        """A message of a stream; see Track.add."""
        track = self.tracks[side].get(name)
        if track is None:
            track = self.tracks[side][name] = Track(topic)
        track.add(time, stamp, file)

    def add_image(self, side: str, name: str, topic: str, time: float, stamp: float, file: int) -> None:
        """An image of a stream that was recorded later than it arrived; see Track.add."""
        self.images.setdefault((side, name), {})[stamp] = time, file, topic

    def add_state(self, side: str, message: Any) -> None:
        """A RobotStatus."""
        time = message.header.stamp.to_sec()
        self.states[side][time] = State(time, message.focus, message.driver, bool(message.estop), {
            stream.name: (bool(stream.enabled), bool(stream.paused), float(stream.rate)) for stream in message.streams})

    def add_link(self, side: str, message: Any) -> None:
        """A LinkStatus."""
        time = message.header.stamp.to_sec()
        self.links[side][time] = LinkState(time, message.rate, message.sent, message.capacity, message.loss,
                                           message.queue_delay, message.round_trip, {
                                               path.name: path.sent for path in getattr(message, 'paths', ())})

    def add_place(self, side: str, time: float, message: Any) -> None:
        """A nav_msgs/Odometry; of those that show no motion one is kept."""
        place, way = message.pose.pose.position, self.ways[side]
        if math.isfinite(place.x) and math.isfinite(place.y) and (
                not way or math.hypot(place.x - way[-1][1], place.y - way[-1][2]) >= LEAST_STEP):
            way.append((time, place.x, place.y))


def read_description(text: str) -> Optional[Description]:
    """The description of a bag; None: it is something else.

    :param text: JSON, see nodes.black_box
    """
    try:
        found = json.loads(text)
        side, named = found['side'], found['streams']
        if side not in SIDES:
            return None
        streams = {str(name): Stream(str(one['type']), bool(one['to_robot'])) for name, one in named.items()}
        roles: Dict[str, List[Tuple[str, str]]] = {}
        for name, one in named.items():
            for topic in one['topics']:
                roles.setdefault(str(topic), []).append((side, str(name)))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return Description(side, str(found.get('namespace', '/')), streams, roles)
