# SPDX-License-Identifier: BSD-3-Clause
"""One end of a link for the benchmark of links, as a process: ``link_peer.py ROLE PORT SIZE KEY``.

ROLE is send (the robot, at the port) or receive (an operator). KEY is hexadecimal. SIZE and the
commands are those of udpros_peer.py in frame mode.
"""
import sys
from typing import Any, List

import rospy

from smokebot_udp.link.transport import OperatorTransport, RobotTransport
from smokebot_udp.msg import ImageSegment

from .udpros_peer import Receiver, Sender, obey

TOPIC = '/bench/segments/link'


def log(text: str) -> None:
    """Standard output is for answers."""
    print(text, file=sys.stderr)


class LinkReceiver(Receiver):
    """Receives frames by the link."""

    def __init__(self, port: int, key: bytes) -> None:
        self.count = 0
        self.ages: List[float] = []
        self._transport = OperatorTransport([('127.0.0.1', port)], key, log=log)
        self.subscriber: Any = self._transport.subscriber(TOPIC, ImageSegment, batch_callback=self.take_batch)

    def ready(self) -> bool:
        return bool(self.subscriber.connections())


class LinkSender(Sender):
    """Sends frames by the link."""

    def __init__(self, port: int, key: bytes, size: int) -> None:
        self.mode, self.size = 'frame', size
        self._transport = RobotTransport(port, key, log=log)
        self.publisher: Any = self._transport.publisher(TOPIC, ImageSegment, queue_size=1000)


def main(role: str, port: str, size: str, key: str) -> None:
    """Run an end until standard input ends."""
    rospy.init_node('link_%s' % role, anonymous=True, disable_signals=True)
    secret = bytes.fromhex(key)
    obey(LinkReceiver(int(port), secret) if role == 'receive' else LinkSender(int(port), secret, int(size)))


if __name__ == '__main__':
    main(*sys.argv[1:])
