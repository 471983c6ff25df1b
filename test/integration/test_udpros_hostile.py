#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS under attack: bad requests, and a million bad datagrams between good ones."""
import contextlib
import logging
import os
import pathlib
import socket
import sys
import unittest
import xmlrpc.client
from typing import Any

import numpy as np
import psutil
import rospy
import rostest
from rosgraph_msgs.msg import Log
from std_msgs.msg import Header

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import is_sent_here, wait_for

from smokebot_udp import limited_log, udpros
from smokebot_udp.msg import ImageSegment
from smokebot_udp.udpros.datagram import HEADER, LENGTH, Op
from smokebot_udp.udpros.negotiation import encode_header

BATCH = 1000
MILLION = 10 ** 6


class Errors(logging.Handler):
    """The ERROR records of rospy's loggers, which include ours."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.records = []
        logging.getLogger('rospy').addHandler(self)

    def emit(self, record) -> None:
        self.records.append(record.getMessage())


class Hostile(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('udpros_hostile')

    def test_bad_requests_are_refused_with_a_reason(self) -> None:
        publisher = udpros.Publisher('/asked', Header, queue_size=1)
        warnings = []
        log = rospy.Subscriber('/rosout', Log, lambda entry: warnings.append(entry.msg))
        wait_for(lambda: is_sent_here(log.resolved_name), what='rosout')
        header = {'topic': '/asked', 'md5sum': Header._md5sum, 'type': Header._type, 'callerid': '/someone'}
        good = [encode_header(header), '127.0.0.1', 5000, 1472]
        lacking = {key: value for key, value in header.items() if key != 'md5sum'}
        errors = Errors()
        for place, value, words in (
                (3, 8, 'max_datagram_size is 8'), (3, 0, 'max_datagram_size is 0'), (3, 10 ** 9, '1000000000'),
                (3, '1472', "max_datagram_size is '1472'"), (2, 0, 'port is 0'), (2, 70000, 'port is 70000'),
                (2, -1, 'port is -1'), (1, '', "host is ''"), (1, 'no.such.host.invalid', 'no route to'),
                (1, 5, 'host is 5'), (0, encode_header(lacking), 'lacks "md5sum"'),
                (0, encode_header({**header, 'md5sum': 'f' * 32}), 'not ffff'),
                (0, b'\xff\xff\xff\xff', 'ends within'), (0, 7, 'not base64')):
            bad = list(good)
            bad[place] = value
            limited_log.forget()    # the log limiter would leave out a refusal of the same kind as the one before
            with xmlrpc.client.ServerProxy(rospy.get_node_uri()) as proxy:
                code, text, _ = proxy.requestTopic('/someone', '/asked', [['UDPROS'] + bad])
            self.assertEqual(code, 0)
            self.assertIn(words, text)
            wait_for(lambda said=text: any(said in warning for warning in warnings), 5, 'a log line: ' + text)
        for offers in ([['UDPROS']], [['UDPROS', 1, 2, 3, 4, 5, 6]], [[]], [7], [['PIGEON']]):
            with xmlrpc.client.ServerProxy(rospy.get_node_uri()) as proxy:
                self.assertNotEqual(proxy.requestTopic('/someone', '/asked', offers)[0], 1)
        self.assertFalse(errors.records)
        self.assertEqual(publisher.get_num_connections(), 0)
        publisher.unregister(), log.unregister()

    def test_a_million_bad_datagrams_between_good_ones(self) -> None:
        """From strangers, and from the publisher's own socket; half of them mutations of good ones."""
        got, records_seen = [], []
        publisher = udpros.Publisher('/flooded', ImageSegment, queue_size=10, transport='udp')
        subscriber = udpros.Subscriber(
            '/flooded', ImageSegment, lambda message: got.append(message.total), transport='udp',
            batch_callback=lambda records, mask: records_seen.extend(records['total'][mask].tolist()))
        wait_for(publisher.get_num_connections, what='the connection')
        transport, = publisher.impl.connections
        peer, own = transport.remote_endpoint, transport.sender.socket.dup()
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        stranger.connect(peer)
        random = np.random.RandomState(1)
        errors, memory = Errors(), None
        for k in range(MILLION // BATCH):
            for datagram in bad_datagrams(random, BATCH, transport.connection_id):
                with contextlib.suppress(BlockingIOError):
                    (own if random.randint(4) else stranger).send(datagram)
            publisher.publish(ImageSegment(total=MILLION + k, encoding='mono8', data=b'good'))
            if k % 50 == 20 and memory is None:
                memory = psutil.Process(os.getpid()).memory_info().rss
            wait_for(lambda wanted=MILLION + k: wanted in got[-200:], 10, 'good message %d' % k)
        self.assertLess(psutil.Process(os.getpid()).memory_info().rss - memory, 10e6)
        wanted = set(range(MILLION, MILLION + MILLION // BATCH))
        for way in (got, records_seen):
            self.assertEqual({total for total in way if total >= MILLION}, wanted)
        self.assertFalse(errors.records)
        connection, = subscriber.connections()
        print('dropped: %s, by the kernel: %s' % (connection['dropped'], connection['kernel_drops']))
        for reason in ('stranger', 'short', 'connection id', 'op', 'length', 'message'):
            self.assertGreater(connection['dropped'][reason], 0, reason)
        subscriber.unregister(), publisher.unregister(), stranger.close(), own.close()


def bad_datagrams(random, count, connection_id) -> Any:
    """Datagrams that are not good messages: random ones, and good ones with a few bytes changed."""
    body = ImageSegment(encoding='mono8', data=b'evil')
    for _ in range(count):
        kind = random.randint(6)
        header = [connection_id, int(Op.DATA0), random.randint(1, 256), 1]
        if kind == 0:
            yield random.bytes(random.randint(0, 60))
            continue
        if kind == 1:
            header = [random.randint(2 ** 31), random.randint(256), random.randint(256), random.randint(65536)]
        elif kind == 2:
            header[1:] = [random.randint(4), random.randint(256), random.choice([0, 1, 2, 50, 65535])]
        payload = serialized(body)
        if kind == 3:
            payload = payload[:random.randint(len(payload))]
        elif kind == 4:
            payload = payload + random.bytes(random.randint(1, 50))
        elif kind == 5:    # a whole message with wrong lengths of its fields
            at = LENGTH.size + random.choice([12, 24, 38])
            payload = payload[:at] + random.bytes(4) + payload[at + 4:]
        yield HEADER.pack(*header) + payload


def serialized(message) -> Any:
    import io
    buffer = io.BytesIO()
    message.serialize(buffer)
    data = buffer.getvalue()
    return LENGTH.pack(len(data)) + data


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'udpros_hostile', Hostile)
