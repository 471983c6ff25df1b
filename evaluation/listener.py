# SPDX-License-Identifier: BSD-3-Clause
"""What arrives at a side of a link lab, and when: a node there that reports each message, and its Listener here.

Each line on the node's standard input is a JSON list of [topic, kind, transport] to subscribe to, in place of those
before; it answers `null` when it has subscribed. It reports each message as a JSON list
[topic, stamp [s] or null, arrival [s], amount].
"""
import json
import struct
import subprocess
import sys
import threading
import time
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
import roslib.message
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CompressedImage, Image, LaserScan, PointCloud2
from tf2_msgs.msg import TFMessage

from smokebot_udp import udpros
from smokebot_udp.codecs.wire.partial_image import RECEIVED
from smokebot_udp.monitoring.status import Kind
from smokebot_udp.msg import LinkStatus, RelaySegment
from smokebot_udp.nodes.status_messages import statuses_of
from smokebot_udp.streams.blank import has_blank
from smokebot_udp.streams.relay.contents import size_of, stamp_of
from smokebot_udp.streams.relay.parts import PartJoiner
from smokebot_udp.streams.relay.repeats import MessageOrder
from smokebot_udp.udpros.rospy_binding import install

from . import TOP
from .stack import Stack

LINK_FIELDS = 'rate', 'sent', 'wanted', 'capacity', 'queue_delay', 'round_trip'

RATES = 'datagrams/s', 'bytes/s'
"""Values of a connection's status."""

KINDS: Dict[str, Tuple[Any, Callable[[Any], Any]]] = {
    'any': (rospy.AnyMsg, lambda message: len(message._buff)),
    'image': (Image, lambda message: len(message.data)),
    'jpeg': (CompressedImage, lambda message: len(message.data)),
    'cloud': (PointCloud2, lambda message: message.width * message.height),
    'mask': (Image, lambda message: float(np.mean(np.frombuffer(message.data, np.uint8) == RECEIVED))),
    'scan': (LaserScan, lambda message: len(message.ranges)),
    'ranges': (LaserScan, lambda message: float(np.mean(~np.isnan(message.ranges)))),
    'odometry': (Odometry, lambda message: 1),
    'twist': (Twist, lambda message: message.linear.x),
    'transforms': (TFMessage, lambda message: len(message.transforms)),
    'link': (LinkStatus, lambda message: {name: getattr(message, name) for name in LINK_FIELDS}),
    'longest': (LinkStatus, lambda message: message.longest_datagram),
    'repetition': (RelaySegment, lambda segment: [segment.number, len(segment.before), size_of(segment)]),
    'diagnostics': (DiagnosticArray, lambda message: [status.message for status in message.status] + [
        pair.key for status in message.status for pair in status.values if 'refused' in pair.key]),
    'parts': (DiagnosticArray, lambda message: {
        status.values['stream']: int(status.values['datagrams']) for status in statuses_of(message.status)
        if status.kind == Kind.CONNECTION}),
    'rates of parts': (DiagnosticArray, lambda message: {
        status.values['stream']: [float(status.values[rate]) for rate in RATES]
        for status in statuses_of(message.status)
        if status.kind == Kind.CONNECTION and all(rate in status.values for rate in RATES)}),
    'link transport': (DiagnosticArray, lambda message: {
        key: value for status in statuses_of(message.status) if status.kind == Kind.TRANSPORT
        for key, value in status.values.items()}),
}
"""{kind: (message class, f(message) -> amount)}; the amount: bytes, points, ranges, transforms, the share of pixels
or ranges that were received, the datagrams or RATES of each part of a stream, the longest datagram that passes, the
content, the speed, or of a relay's segment the number, the bytes of the message before and all bytes."""

RELAYED = {'relayed odometry': 'odometry', 'relayed transforms': 'transforms'}
"""{kind of a relay's segments, as they leave: kind of the messages that they carry}"""

LARGE = {Image, CompressedImage, PointCloud2}
"""Message classes whose subscribers have a queue of two messages."""

STAMP = struct.Struct('<II')
"""Format of a header's stamp, which follows its sequence number: seconds, nanoseconds."""

TRANSPORTS = {'TCPROS': 'tcp', 'UDPROS': 'udp'}

Subscription = Sequence[str]
"""(topic, one of KINDS, one of TRANSPORTS)"""


class Heard(NamedTuple):
    """A message that arrived."""
    topic: str
    stamp: Optional[float]
    """Time stamp of the source; None: the message has none [s]."""
    arrival: float
    """Time of arrival by the same clock: both sides of a lab are one machine [s]."""
    amount: Any
    """Amount of the message, see KINDS."""

    @property
    def age(self) -> float:
        """The time from stamp to arrival; NaN without a stamp [s]."""
        return float('nan') if self.stamp is None else self.arrival - self.stamp


class Listener:
    """The node, and all that it heard.

    :param stack: the node becomes a part of it
    :param side: where the node runs
    :param module: the node's module and its arguments: this one, or one that extends KINDS
    :raises RuntimeError: where the node does not start
    """

    def __init__(self, stack: Stack, side: str = 'operator', module: Sequence[str] = (__name__,)) -> None:
        self.heard: List[Heard] = []
        self._subscribed = threading.Event()
        self.process = process = stack.start(side, sys.executable, '-m', *module, cwd=str(TOP), stdin=subprocess.PIPE,
                                             stdout=subprocess.PIPE, universal_newlines=True)
        assert process.stdin is not None and process.stdout is not None
        self._stdin, self._stdout = process.stdin, process.stdout
        if not self._stdout.readline():
            raise RuntimeError('the listener ended with exit code %r' % process.wait())
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._stdout:
            values = json.loads(line)
            if values is None:
                self._subscribed.set()
            else:
                self.heard.append(Heard(*values))

    def subscribe(self, subscriptions: Iterable[Subscription], timeout: float = 30.0) -> None:
        """Listen to other topics from now on.

        It needs a good link: the node calls the master on the other side.

        :param timeout: [s]
        :raises RuntimeError: where it takes longer
        """
        self._subscribed.clear()
        self._stdin.write(json.dumps(list(subscriptions)) + '\n')
        self._stdin.flush()
        if not self._subscribed.wait(timeout):
            raise RuntimeError('the listener cannot subscribe')

    def during(self, seconds: float) -> List[Heard]:
        """What arrives from now on."""
        count = len(self.heard)
        time.sleep(seconds)
        return self.heard[count:]

    def first(self, topics: Iterable[str], timeout: float,
              counts: Callable[[Heard], bool] = lambda heard: True) -> Dict[str, float]:
        """When the first message of each topic arrives: {topic: [s] from now}, without the topics that stay silent.

        :param timeout: [s]
        :param counts: whether a message does
        """
        begun, count, missing = time.time(), len(self.heard), set(topics)
        found: Dict[str, float] = {}
        while missing and time.time() < begun + timeout:
            time.sleep(0.02)
            arrived = self.heard[count:]
            count += len(arrived)
            for heard in arrived:
                if heard.topic in missing and counts(heard):
                    missing.remove(heard.topic)
                    found[heard.topic] = heard.arrival - begun
        return found


REPORTS = sys.stdout


def write_line(value: Any) -> None:
    """Write a line of JSON at once: each topic has a thread of its own, and print would write the line's end apart."""
    REPORTS.write(json.dumps(value) + '\n')
    REPORTS.flush()


def stamp(message: Any) -> Optional[float]:
    """The stamp of a message, also of an AnyMsg [s]; None: its type has none."""
    if isinstance(message, rospy.AnyMsg):
        message_class = roslib.message.get_message_class(message._connection_header['type'])
        if message_class is None:
            return None
        if message_class._has_header:
            seconds, nanoseconds = STAMP.unpack_from(message._buff, 4)
            return float(seconds + 1e-9 * nanoseconds)
        if not issubclass(message_class, TFMessage):
            return None
        message = TFMessage().deserialize(message._buff)
    found = stamp_of(message)
    return None if found is None else float(found.to_sec())


def is_blank(message: Any) -> bool:
    """Whether operator_receiver published it in place of an old message, see streams.blank; also of an AnyMsg."""
    type_ = message._connection_header['type'] if isinstance(message, rospy.AnyMsg) else message._type
    return has_blank(roslib.message.get_message_class(type_)) and stamp(message) == 0


class Relayed:
    """The messages that a relay's segments carry."""

    def __init__(self, message_class: Any) -> None:
        self._class, self._joiner = message_class, PartJoiner(message_class)
        self._order = MessageOrder(self._joiner.dropped)

    def messages(self, segment: RelaySegment) -> List[Any]:
        """The messages that a segment completes."""
        data = self._joiner.add(segment)
        found = [] if data is None else self._order.add(segment.number, data, segment.before)
        return [self._class().deserialize(one) for one in found]


def subscribe(topic: str, kind: str, transport: str) -> Any:
    """A subscriber that reports each message."""
    message_class, amount = KINDS[RELAYED.get(kind, kind)]

    def report(message: Any) -> None:
        arrival = time.time()
        if not is_blank(message):
            write_line([topic, stamp(message), arrival, amount(message)])

    if kind in RELAYED:
        relayed = Relayed(message_class)

        def report_segment(segment: RelaySegment) -> None:
            for message in relayed.messages(segment):
                report(message)
        return udpros.Subscriber(topic, RelaySegment, report_segment, queue_size=100, tcp_nodelay=True,
                                 transport=TRANSPORTS[transport])

    if kind == 'any':
        return rospy.Subscriber(topic, message_class, report, queue_size=100)
    # udpros' class for both transports: it connects by TCPROS, too
    return udpros.Subscriber(topic, message_class, report, queue_size=2 if message_class in LARGE else 100,
                             buff_size=1 << 22, tcp_nodelay=True, transport=TRANSPORTS[transport])


def main(start: Callable[[], Any] = lambda: None) -> None:
    """Run the node until its standard input ends.

    :param start: called as soon as there is the node
    """
    sys.stdout = sys.stderr     # where rospy logs
    udpros.race_all_connections()
    rospy.init_node('listener', anonymous=True)     # there may be one on each side
    rospy.loginfo('listening')      # rospy's first message asks the master for a parameter: not while the link is cut
    install()   # it registers again with a new master
    start()
    write_line('ready')

    def obey() -> None:
        subscribers: List[Any] = []
        for line in sys.stdin:
            for subscriber in subscribers:
                subscriber.unregister()
            subscribers = [subscribe(*subscription) for subscription in json.loads(line)]
            write_line(None)
        rospy.signal_shutdown('the standard input ended')

    threading.Thread(target=obey, daemon=True).start()
    rospy.spin()


if __name__ == '__main__':
    main()
