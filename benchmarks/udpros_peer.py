# SPDX-License-Identifier: BSD-3-Clause
"""One end of a topic for the UDPROS benchmark, as a process: ``udpros_peer.py ROLE MODE TOPIC [SIZE]``.

ROLE is send or receive. MODE is tcp (plain rospy), tcp_direct (without a queue), message, frame, or bare (sockets
without ROS; TOPIC is then the receiver's port). It prints "ready" when it is connected, and then executes commands from
stdin: ``begin``, ``send RATE SECONDS``, ``report``. Each is answered by a line, the last two by JSON.
"""
import json
import socket
import struct
import sys
import threading
import time
from typing import Any, Dict, List

import numpy as np
import rospy

from smokebot_udp import udpros
from smokebot_udp.msg import ImageSegment
from smokebot_udp.nodes import malloc_tuning
from smokebot_udp.udpros.endpoints import DatagramReceiver, DatagramSender

SIZE = 1400
"""SIZE's default: bytes of data in a message, without its other fields [byte]."""

FRAME_RATE = 50
"""Frames in frame and bare mode [Hz]."""

SEGMENTS = 44
"""The most messages of this size that the kernel segments in one call."""

BURST, BURST_PERIOD = 3 * SEGMENTS, 2.4e-3
"""A frame is sent in bursts of this many messages, which a receive buffer of the default size holds, at this interval
[s]. This spreads 27000 messages/s over half of the time."""

QUEUES = {'tcp': 1000, 'tcp_direct': None}
"""rospy's queue_size: with a queue a thread sends, without it the caller."""


class Receiver:
    """Counts messages and their ages."""

    def __init__(self, mode: str, topic: str) -> None:
        self.count = 0
        self.ages: List[float] = []
        self.subscriber: Any
        if mode == 'frame':
            self.subscriber = udpros.Subscriber(topic, ImageSegment, transport='udp', batch_callback=self.take_batch)
        elif mode == 'message':
            self.subscriber = udpros.Subscriber(topic, ImageSegment, self.take, transport='udp')
        else:
            self.subscriber = rospy.Subscriber(topic, ImageSegment, self.take, tcp_nodelay=True, buff_size=1 << 22)

    def take(self, message: Any) -> None:
        self.count += 1
        self.ages.append((rospy.Time.now() - message.header.stamp).to_sec())

    def take_batch(self, records: Any, mask: Any) -> None:
        self.count += int(np.count_nonzero(mask))
        first = records['header']['stamp'][mask.argmax()]
        self.ages.append(time.time() - int(first['secs']) - 1e-9 * int(first['nsecs']))

    def ready(self) -> bool:
        return self.subscriber.get_num_connections() > 0

    def begin(self) -> None:
        self.count, self.ages = 0, []

    def report(self) -> Dict[str, Any]:
        ages: Any = np.percentile(self.ages, (50, 99)) if self.ages else (None, None)
        return {'received': self.count, 'p50': ages[0], 'p99': ages[1]}


class BareReceiver:
    """Receives by recvmmsg and does nothing else."""

    def __init__(self, _: str) -> None:
        self.receiver, self.count = DatagramReceiver('127.0.0.1', 1472), 0
        print(self.receiver.address[1], flush=True)
        threading.Thread(target=self.run, daemon=True).start()

    def run(self) -> None:
        while True:
            if self.receiver.wait(1.0):
                time.sleep(1e-3)
                self.count += self.receiver.receive()

    def ready(self) -> bool:
        return True

    def begin(self) -> None:
        self.count = 0

    def report(self) -> Dict[str, Any]:
        return {'received': self.count, 'p50': None, 'p99': None}


class Sender:
    """Sends messages one by one, or in frame mode FRAME_RATE frames of them per second."""

    def __init__(self, mode: str, topic: str, size: int = SIZE) -> None:
        self.mode, self.size = mode, size
        self.publisher: Any
        if mode in QUEUES:
            self.publisher = rospy.Publisher(topic, ImageSegment, queue_size=QUEUES[mode], tcp_nodelay=True)
        else:
            self.publisher = udpros.Publisher(topic, ImageSegment, queue_size=1000)
        self.message = ImageSegment(encoding='mono8', data=bytes(size))

    def ready(self) -> bool:
        return self.publisher.get_num_connections() > 0

    def send(self, rate: float, seconds: float) -> int:
        return self.send_frames(rate, seconds) if self.mode == 'frame' else self.send_messages(rate, seconds)

    def send_messages(self, rate: float, seconds: float) -> int:
        sent, due = 0, time.monotonic()
        for tick in range(int(seconds * 1000)):
            time.sleep(max(0.0, due - time.monotonic()))
            due += 1e-3
            while sent < rate * (tick + 1) / 1000:
                self.message.header.stamp = rospy.Time.now()
                self.publisher.publish(self.message)
                sent += 1
        return sent

    def send_frames(self, rate: float, seconds: float) -> int:
        count = int(rate / FRAME_RATE)
        frame = udpros.Frame(ImageSegment, count, {'encoding': 5, 'data': self.size})
        data = np.zeros((count, self.size), np.uint8)
        due = time.monotonic()
        for _ in range(int(seconds * FRAME_RATE)):
            time.sleep(max(0.0, due - time.monotonic()))
            due += 1.0 / FRAME_RATE
            stamp = rospy.Time.now()
            stamps = frame.records['header']['stamp']
            stamps['secs'], stamps['nsecs'] = stamp.secs, stamp.nsecs
            frame.records['data'] = data        # as a stream does with its image
            leave = time.monotonic()
            for start in range(0, count, BURST):
                time.sleep(max(0.0, leave - time.monotonic()))
                self.publisher.publish_frames(frame.part(start, start + BURST))
                leave += BURST_PERIOD
        return count * int(seconds * FRAME_RATE)


class BareSender:
    """Prepared datagrams through GSO and nothing else."""

    def __init__(self, port: str) -> None:
        self.sender = DatagramSender('127.0.0.1', int(port))

    def ready(self) -> bool:
        return True

    def send(self, rate: float, seconds: float) -> int:
        count = int(rate / FRAME_RATE)
        datagrams, control = bytes(count * 1460), [(17, 103, struct.pack('=H', 1460))]
        due = time.monotonic()
        for _ in range(int(seconds * FRAME_RATE)):
            time.sleep(max(0.0, due - time.monotonic()))
            due += 1.0 / FRAME_RATE
            for at in range(0, len(datagrams), SEGMENTS * 1460):
                self.sender.socket.sendmsg([datagrams[at:at + SEGMENTS * 1460]], control)
                time.sleep(5e-4)
        return count * int(seconds * FRAME_RATE)


def main(role: str, mode: str, topic: str, size: str = '%d' % SIZE) -> None:
    end: Any
    if mode == 'bare':
        end = (BareReceiver if role == 'receive' else BareSender)(topic)
    else:
        rospy.init_node('%s_%s' % (mode, role), disable_signals=True)
        end = Receiver(mode, topic) if role == 'receive' else Sender(mode, topic, int(size))
    obey(end)


def obey(end: Any) -> None:
    """Execute commands until standard input ends.

    :param end: a receiver or sender, see above
    """
    malloc_tuning.keep_freed_memory()     # as both nodes do
    while not end.ready():
        time.sleep(0.01)
    print('ready', flush=True)
    before = 0.0
    for line in sys.stdin:
        word, *numbers = line.split()
        if word == 'begin':
            end.begin()
            before = time.process_time()
            print('ok', flush=True)
        elif word == 'send':
            before, begun = time.process_time(), time.monotonic()
            sent = end.send(*map(float, numbers))
            seconds = time.monotonic() - begun
            time.sleep(0.2)
            print(json.dumps({'sent': sent, 'seconds': seconds, 'cpu': time.process_time() - before}), flush=True)
        elif word == 'report':
            used = time.process_time() - before
            print(json.dumps(dict(end.report(), cpu=used)), flush=True)


if __name__ == '__main__':
    socket.setdefaulttimeout(None)
    main(*sys.argv[1:])
