# SPDX-License-Identifier: BSD-3-Clause
"""A robot and an operator that find each other over a lossy network, without sockets and threads: cores and tables.

Both have the topics of config/streams.yaml, and some further relays. Time is simulated.
"""
import pathlib
from typing import Any, Callable, Dict, FrozenSet, List, Optional, Tuple

from link_channel import KEY, OPERATOR, ROBOT, SIZE, Address, Network, random_bytes

from smokebot_udp.link.operator_core import OperatorCore
from smokebot_udp.link.peer import Delivery, Joined, Left
from smokebot_udp.link.peer_topics import PeerTopics
from smokebot_udp.link.place import place_at
from smokebot_udp.link.robot_core import RobotCore
from smokebot_udp.link.tables import Local, Role, Topic
from smokebot_udp.msg import RelaySegment
from smokebot_udp.streams import classified, config, encoder_class
from smokebot_udp.streams.segments import INFO, MAIN_PART, wire_topic
from smokebot_udp.udpros.control_messages import KERNELS, Via

STREAMS = pathlib.Path(__file__).resolve().parents[2] / 'config' / 'streams.yaml'
STEP = 0.02
"""Between two looks at what is due [s]."""

UP = ('link/report', 'clock/ask', 'held', 'capture/request', 'control/request',
      'reliable/to_robot', 'cmd_vel/commands')
DOWN = ('clock/answer', 'capture/pieces', 'control/status', 'reliable/to_operator')
"""Topics of no stream."""


def topic(name: str, message_class: Any, carries: str = '') -> Topic:
    return Topic(name, message_class._type, message_class._md5sum, carries)


def topics_down(relays: int) -> Dict[str, Topic]:
    """{name of the stream and part: topic} that the robot sends."""
    definitions = classified(config.load(STREAMS.read_text())[0]).streams
    found = {}
    for name, settings in definitions.items():
        class_ = encoder_class(settings['type'])
        for part, segment in class_.SEGMENTS.items():
            found['%s/%s' % (name, part)] = topic(wire_topic(name, part), segment, 'x/Y 0' * (class_.SEGMENTS.get(
                MAIN_PART) is RelaySegment))
    for number in range(relays):
        found['relay%d' % number] = topic('/smokebot_udp/sensor_with_a_name_%d/segments' % number, RelaySegment,
                                          'some_package_msgs/SensorReading%d %032x' % (number, number))
    return {**found, **{name: topic('/smokebot_udp/' + name, RelaySegment) for name in DOWN}}


class Wish:
    """A subscriber, as PeerTopics.asked needs it."""

    def __init__(self, gated: bool) -> None:
        self._gated = gated

    def wants(self, offered: bool) -> bool:
        return offered or not self._gated

    def connect(self, peer: Any) -> None:
        """There is nothing to connect."""


class Sender:
    """What PeerTopics sends with."""
    failures: Dict[str, int] = {}

    def __init__(self, network: Network, source: Address) -> None:
        self._network, self._source = network, source

    tos = 0

    def another(self, tos: int) -> 'Sender':
        return Sender(self._network, self._source)

    def send_one(self, *parts: Any, to: Address, via: Via = KERNELS) -> int:
        self._network.send(self._source, to, b''.join(bytes(part) for part in parts))
        return 1

    def send(self, datagrams: Any, size: int, count: int, to: Address, via: Via = KERNELS) -> int:
        data = bytes(datagrams)
        for at in range(0, count * size, size):
            self.send_one(data[at:at + size], to=to)
        return count


class Side:
    """A core, its topics, and what it has of each peer."""

    def __init__(self, network: Network, address: Address, core: Any, wishes: Dict[int, Wish]) -> None:
        self.core, self.local, self.wishes = core, Local(), wishes
        self.peers: Dict[int, PeerTopics] = {}
        self.joined: Optional[float] = None
        self._network, self._address = network, address
        self._seen = self._taken = 0
        network.add(address, core)

    @property
    def exchange(self) -> Any:
        """With the only peer; None: there is none."""
        return next(iter(self.peers.values())).exchange if self.peers else None

    def poll(self, now: float) -> None:
        """Take what has happened, and send what is due."""
        network = self._network
        for when, where, event in network.events[self._seen:]:
            if where == self._address and isinstance(event, Joined):
                sender: Any = Sender(network, where)
                self.peers[event.peer.number] = PeerTopics(event.peer, self.local, sender)
                self.joined = when
            elif where == self._address and isinstance(event, Left):
                self.peers.pop(event.peer.number, None)
        for _, where, delivery in network.deliveries[self._taken:]:
            if where == self._address:
                self._take(delivery, now)
        self._seen, self._taken = len(network.events), len(network.deliveries)
        for topics in self.peers.values():
            topics.update_room(SIZE, now)
            wishes: Any = self.wishes
            topics.ask(wishes)
            topics.send(now)

    def _take(self, delivery: Delivery, now: float) -> None:
        topics = self.peers.get(delivery.peer.number)
        if topics is None:
            return
        for row in range(len(delivery.lengths)):
            number = int(delivery.datagrams[row, :4].copy().view('<u4')[0])
            topics.take(number, delivery.datagrams[row:row + 1], delivery.lengths[row:row + 1], now)


class JoinWorld:
    """A robot and an operator over a network.

    :param loss: each way
    :param relays: beside the default streams
    """

    def __init__(self, seed: int, loss: float, relays: int = 0, delay: float = 0.02) -> None:
        self.network = Network(seed, delay=delay, loss=loss)
        self.down = topics_down(relays)
        gated = {self.down[name].id for name in self.down if name.endswith(('/layers', '/video', '/tiles'))}
        wishes = {one.id: Wish(one.id in gated) for one in self.down.values()}
        up = [topic('/smokebot_udp/' + name, RelaySegment) for name in UP]
        self.robot = Side(self.network, ROBOT, RobotCore(KEY, random_bytes(2 * seed), SIZE, '/robot_sender@ugv1'),
                          {one.id: Wish(False) for one in up})
        operator = OperatorCore(KEY, random_bytes(2 * seed + 1), SIZE, '/operator_receiver@desk1')
        self.operator = Side(self.network, OPERATOR, operator, wishes)
        for one in self.down.values():
            self.robot.local.add(Role.SENDS, one)
            self.operator.local.add(Role.RECEIVES, one)
        for one in up:
            self.robot.local.add(Role.RECEIVES, one)
            self.operator.local.add(Role.SENDS, one)
        self.needed: FrozenSet[int] = frozenset(
            one.id for name, one in self.down.items() if not name.endswith('/' + INFO))
        self._reports = 0.0
        operator.set_places([place_at(ROBOT)], self.network.now)

    def run(self, seconds: float, until: Callable[[], bool]) -> Optional[float]:
        """When `until` became true; None: it did not [s]."""
        network, end = self.network, self.network.now + seconds
        while network.now < end:
            network.run(STEP)
            for side in (self.robot, self.operator):
                side.poll(network.now)
            if network.now >= self._reports:    # the operator's link reports, ten times a second
                self._reports = network.now + 0.1
                for peer in self.operator.core.peers:
                    network.send(OPERATOR, ROBOT, peer.seal_one(bytes([99, 0, 0, 1]) + bytes(200)))
            if until():
                return network.now
        return None

    def wanted(self) -> bool:
        """Whether the robot knows that the operator wants all: layers, video and tiles among them."""
        return self.robot.exchange is not None and self.robot.exchange.wants >= self.needed

    def bytes_sent(self, source: Address, since: int = 0) -> int:
        """As IP packets [byte]."""
        return sum(len(packet) + 28 for origin, _, packet in self.network.log[since:] if origin == source)


def times_to_join(runs: int, loss: float, relays: int, limit: float) -> List[Tuple[float, float]]:
    """[(from the start to the operator's join, from then until the robot knows its wants)] [s]; inf: not in time"""
    found = []
    for seed in range(runs):
        world = JoinWorld(seed, loss, relays)
        begun = world.network.now
        done = world.run(limit, world.wanted)
        joined = world.operator.joined
        found.append((float('inf') if joined is None else joined - begun,
                      float('inf') if done is None or joined is None else done - joined))
    return found
