# SPDX-License-Identifier: BSD-3-Clause
"""One end of a topic for the UDPROS benchmark, as a process: ``udpros_peer.py ROLE MODE TOPIC``.

ROLE is send or receive, MODE tcp (rospy as it is), tcp_direct (without a queue), message, frame, or bare (sockets
without ROS, where TOPIC is the receiver's port). It says "ready" when it is connected, and then obeys lines on
stdin: ``begin``, ``send RATE SECONDS``, ``report``; each is answered by a line, the last two by JSON.
"""
import json
import socket
import struct
import sys
import time

import numpy as np
import rospy

from smokebot_udp import udpros
from smokebot_udp.msg import ImageSegment
from smokebot_udp.udpros.endpoints import DatagramReceiver, DatagramSender

SIZE = 1400
"""Bytes of data in a message; all of it is a little more [byte]."""

FRAMES = 50
"""A second, in frame and bare mode [Hz]."""

QUEUES = {'tcp': 1000, 'tcp_direct': None}
"""rospy's queue_size: with one, a thread sends, without, the caller."""


class Receiver:
    def __init__(self, mode, topic):
        self.mode, self.count, self.ages = mode, 0, []
        if mode == 'frame':
            self.subscriber = udpros.Subscriber(topic, ImageSegment, transport='udp', batch_callback=self.take_batch)
        elif mode == 'message':
            self.subscriber = udpros.Subscriber(topic, ImageSegment, self.take, transport='udp')
        else:
            self.subscriber = rospy.Subscriber(topic, ImageSegment, self.take, tcp_nodelay=True, buff_size=1 << 22)

    def take(self, message):
        self.count += 1
        self.ages.append((rospy.Time.now() - message.header.stamp).to_sec())

    def take_batch(self, records, mask):
        self.count += int(np.count_nonzero(mask))
        first = records['header']['stamp'][mask.argmax()]
        self.ages.append(time.time() - int(first['secs']) - 1e-9 * int(first['nsecs']))

    def ready(self):
        return self.subscriber.get_num_connections()

    def begin(self):
        self.count, self.ages = 0, []

    def report(self):
        ages = np.percentile(self.ages, (50, 99)) if self.ages else (None, None)
        return {'received': self.count, 'p50': ages[0], 'p99': ages[1]}


class BareReceiver:
    """recvmmsg and nothing else; runs in the main thread while a round lasts."""

    def __init__(self, port):
        import threading
        self.receiver, self.count = DatagramReceiver('127.0.0.1', 1472), 0
        print(self.receiver.address[1], flush=True)
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            if self.receiver.wait(1.0):
                time.sleep(1e-3)
                self.count += self.receiver.receive()

    def ready(self):
        return True

    def begin(self):
        self.count = 0

    def report(self):
        return {'received': self.count, 'p50': None, 'p99': None}


class Sender:
    def __init__(self, mode, topic):
        self.mode = mode
        # all of a frame within half of its period, as many at once as the kernel cuts up in a call
        self.pacer = udpros.Pacer(2 * 27000 * 1472, 44 * 1472) if mode == 'frame' else None
        if mode in QUEUES:
            self.publisher = rospy.Publisher(topic, ImageSegment, queue_size=QUEUES[mode], tcp_nodelay=True)
        else:
            self.publisher = udpros.Publisher(topic, ImageSegment, queue_size=1000, pacer=self.pacer)
        self.message = ImageSegment(encoding='mono8', data=bytes(SIZE))

    def ready(self):
        return self.publisher.get_num_connections()

    def send(self, rate, seconds):
        return self.send_frames(rate, seconds) if self.mode == 'frame' else self.send_messages(rate, seconds)

    def send_messages(self, rate, seconds):
        sent, due = 0, time.monotonic()
        for tick in range(int(seconds * 1000)):
            time.sleep(max(0.0, due - time.monotonic()))
            due += 1e-3
            while sent < rate * (tick + 1) / 1000:
                self.message.header.stamp = rospy.Time.now()
                self.publisher.publish(self.message)
                sent += 1
        return sent

    def send_frames(self, rate, seconds):
        count = int(rate / FRAMES)
        frame = udpros.Frame(ImageSegment, count, {'encoding': 5, 'data': SIZE})
        data = np.zeros((count, SIZE), np.uint8)
        due = time.monotonic()
        for _ in range(int(seconds * FRAMES)):
            time.sleep(max(0.0, due - time.monotonic()))
            due += 1.0 / FRAMES
            stamp = rospy.Time.now()
            stamps = frame.records['header']['stamp']
            stamps['secs'], stamps['nsecs'] = stamp.secs, stamp.nsecs
            frame.records['data'] = data        # as a stream does with its picture
            self.publisher.publish_frames(frame)
        return count * int(seconds * FRAMES)


class BareSender:
    """Ready datagrams through GSO and nothing else."""

    def __init__(self, port):
        self.sender = DatagramSender('127.0.0.1', int(port))

    def ready(self):
        return True

    def send(self, rate, seconds):
        count = int(rate / FRAMES)
        datagrams, control = bytes(count * 1460), [(17, 103, struct.pack('=H', 1460))]
        due = time.monotonic()
        for _ in range(int(seconds * FRAMES)):
            time.sleep(max(0.0, due - time.monotonic()))
            due += 1.0 / FRAMES
            for at in range(0, len(datagrams), 44 * 1460):
                self.sender.socket.sendmsg([datagrams[at:at + 44 * 1460]], control)
                time.sleep(5e-4)
        return count * int(seconds * FRAMES)


def main(role, mode, topic):
    if mode == 'bare':
        end = (BareReceiver if role == 'receive' else BareSender)(topic)
    else:
        rospy.init_node('%s_%s' % (mode, role), disable_signals=True)
        end = (Receiver if role == 'receive' else Sender)(mode, topic)
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
    main(*sys.argv[1:4])
