# SPDX-License-Identifier: BSD-3-Clause
"""What comes to a side of a lab, and when: a node there that tells each message, and who listens to it.

Each line on the node's standard input is a JSON list of [topic, kind, transport] to subscribe from then on, instead of
those before; `null` answers when that is done. Each message is told as a JSON list
[topic, stamp [s] or null, arrival [s], amount].
"""
import json
import subprocess
import sys
import threading
import time
from typing import Any, NamedTuple, Optional

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CompressedImage, Image, LaserScan, PointCloud2
from tf2_msgs.msg import TFMessage

from .. import udpros
from ..codecs.wire.partial_image import RECEIVED
from ..msg import LinkStatus
from ..streams.relay import stamp_of

KINDS = {
    'any': (rospy.AnyMsg, lambda message: len(message._buff)),
    'image': (Image, lambda message: len(message.data)),
    'jpeg': (CompressedImage, lambda message: len(message.data)),
    'cloud': (PointCloud2, lambda message: message.width * message.height),
    'mask': (Image, lambda message: float(np.mean(np.frombuffer(message.data, np.uint8) == RECEIVED))),
    'scan': (LaserScan, lambda message: len(message.ranges)),
    'odometry': (Odometry, lambda message: 1),
    'transforms': (TFMessage, lambda message: len(message.transforms)),
    'link': (LinkStatus, lambda message: {name: getattr(message, name) for name in (
        'rate', 'sent', 'wanted', 'capacity', 'queue_delay', 'round_trip')}),
    'diagnostics': (DiagnosticArray, lambda message: [status.message for status in message.status] + [
        pair.key for status in message.status for pair in status.values if 'refused' in pair.key]),
}
"""{kind: (type, f(message) -> amount: bytes, points, ranges, transforms, the share of the pixels that was received, or
what a message says)}"""

LARGE = {Image, CompressedImage, PointCloud2}
"""Of these only a few wait to be told."""

TRANSPORTS = {'TCPROS': 'tcp', 'UDPROS': 'udp'}


class Heard(NamedTuple):
    """A message that came to the operator."""
    topic: str
    stamp: Optional[float]
    """[s]; None where it tells none."""
    arrival: float
    """[s], of the same clock: both sides of a lab are one machine."""
    amount: Any
    """See KINDS."""

    @property
    def age(self):
        """[s]"""
        return self.arrival - self.stamp


class Listener:
    """The node, and all that it heard.

    :param stack: stack.Stack, of which it becomes a part
    :param side: where the node is
    :param module: what is run there, with its arguments: this one, or one that adds to KINDS
    :raises RuntimeError: where the node does not start
    """

    def __init__(self, stack, side='operator', module=(__name__,)):
        self.heard = []
        self._subscribed = threading.Event()
        self._process = stack.start(side, sys.executable, '-m', *module, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                    universal_newlines=True)
        if not self._process.stdout.readline():
            raise RuntimeError('the listener ended with exit code %r' % self._process.wait())
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self._process.stdout:
            told = json.loads(line)
            if told is None:
                self._subscribed.set()
            else:
                self.heard.append(Heard(*told))

    def subscribe(self, wanted, seconds=30.0):
        """Hear of other topics from now on; over a good link: it takes calls to the master on the other side.

        :param wanted: [[topic, one of KINDS, one of TRANSPORTS], ...]
        :param seconds: that may take so long, else RuntimeError
        """
        self._subscribed.clear()
        self._process.stdin.write(json.dumps(wanted) + '\n')
        self._process.stdin.flush()
        if not self._subscribed.wait(seconds):
            raise RuntimeError('the listener cannot subscribe')

    def during(self, seconds):
        """[Heard, ...] from now on."""
        count = len(self.heard)
        time.sleep(seconds)
        return self.heard[count:]

    def first(self, topics, seconds):
        """When the first message of each topic comes from now on: {topic: [s] from now}; those that do not are missing.

        :param seconds: so long it is waited for
        """
        begun, count, found = time.time(), len(self.heard), {}
        while len(found) < len(topics) and time.time() < begun + seconds:
            time.sleep(0.02)
            came = self.heard[count:]
            count += len(came)
            for heard in came:
                if heard.topic in topics:
                    found.setdefault(heard.topic, heard.arrival - begun)
        return found


def tell(value):
    """A line, in one piece: print would write its end by itself, and topics have threads of their own."""
    sys.stdout.write(json.dumps(value) + '\n')
    sys.stdout.flush()


def subscribe(topic, kind, transport):
    message_class, amount = KINDS[kind]

    def take(message):
        arrival, stamp = time.time(), stamp_of(message)
        tell([topic, None if stamp is None else stamp.to_sec(), arrival, amount(message)])

    if kind == 'any':
        return rospy.Subscriber(topic, message_class, take, queue_size=100)
    # with udpros' own class for both: it, too, comes by TCPROS where that is asked for
    return udpros.Subscriber(topic, message_class, take, queue_size=2 if message_class in LARGE else 100,
                             buff_size=1 << 22, tcp_nodelay=True, transport=TRANSPORTS[transport])


def main():
    rospy.init_node('listener', anonymous=True)     # there may be one on each side
    tell('ready')

    def obey():
        subscribers = []
        for line in sys.stdin:
            for subscriber in subscribers:
                subscriber.unregister()
            subscribers = [subscribe(*wanted) for wanted in json.loads(line)]
            tell(None)
        rospy.signal_shutdown('nobody listens')
    threading.Thread(target=obey, daemon=True).start()
    rospy.spin()


if __name__ == '__main__':
    main()
