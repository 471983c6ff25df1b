# SPDX-License-Identifier: BSD-3-Clause
"""What a stranger on the network may do to nodes: forged and senseless calls of their XML-RPC, and forged reports.

    python3 -m evaluation.hostile_flood --seconds 60 --calls 10000 --seed 1 /robot_sender /operator_receiver

It needs no more than the names of the nodes: they tell anybody their topics, peers and ports. It never calls
`shutdown`, to which every ROS node obeys. It prints, as JSON, how many calls of each kind were made, how many of them
were granted, and how long they took.
"""
import argparse
import collections
import contextlib
import io
import json
import random
import re
import socket
import sys
import threading
import time
import urllib.parse
import xmlrpc.client
from typing import Any, Callable, Counter, Dict, List, NamedTuple, Optional, Sequence

import rosgraph

from smokebot_udp.msg import ArrivalMark, LinkReport, StreamArrivals
from smokebot_udp.udpros.datagram import HEADER, LENGTH, Op
from smokebot_udp.udpros.negotiation import Request

from .forged_packets import Forger

WORKERS = 4
"""Number of calls at the same time."""

TIMEOUT = 5.0
"""Timeout of a call [s]."""

REPORTS = 0.1
"""Mean number of forged reports for each call."""

CONNECTION_IDS = 32
"""Connection ids are guessed below this number: a node counts its connections."""

HOSTS = '127.0.0.1', '224.0.0.251', '255.255.255.255', '0.0.0.0', '240.0.0.1', 'localhost', 'no.such.host.invalid'
SIZES = 1472, 1472, 1500, 548, 100, 64, 8, 65507
REPORT = re.compile(r'connection on port (\d+) to \[([^\s:]+):(\d+)')


class Target(NamedTuple):
    """What a node says of itself."""
    uri: str
    published: List[List[str]]
    """[topic, type] each."""
    subscribed: List[List[str]]
    connections: List[List[Any]]
    """Entries of getBusInfo."""


class _Transport(xmlrpc.client.Transport):
    def make_connection(self, host: Any) -> Any:
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT
        return connection


def call(uri: str, method: str, *args: Any) -> Any:
    """Call a node's or the master's API over a connection of its own: [code, text, value].

    :raises OSError, xmlrpc.client.Error: without an answer
    """
    with xmlrpc.client.ServerProxy(uri, transport=_Transport(), allow_none=True) as proxy:
        return getattr(proxy, method)(*args)


def look_at(uri: str) -> Target:
    """Ask a node for its topics and connections."""
    return Target(uri, *(call(uri, method, '/stranger')[2]
                         for method in ('getPublications', 'getSubscriptions', 'getBusInfo')))


class HostileFlood(threading.Thread):
    """Makes random calls of some nodes, evenly over a time, and sends forged reports.

    :param uris: of the nodes
    :param seconds: how long
    :param calls: how many of them
    :param seed: of what they are
    """

    def __init__(self, uris: Sequence[str], seconds: float = 60.0, calls: int = 10000, seed: int = 0) -> None:
        super().__init__(name='hostile flood', daemon=True)
        self.counts: Counter[str] = collections.Counter()
        """{kind of call: how many}, and likewise `<kind>, granted` and `<kind>, failed`."""
        self.slowest = 0.0
        """The longest time that a call took [s]."""
        self._uris, self._seconds, self._calls, self._seed = list(uris), seconds, calls, seed
        self._ended, self._lock = threading.Event(), threading.Lock()
        self._next = 0

    def stop(self) -> None:
        """End it early."""
        self._ended.set()

    def run(self) -> None:
        """Make the calls; returns after the last."""
        targets = [look_at(uri) for uri in self._uris]
        begun = time.monotonic()
        workers = [threading.Thread(target=self._work, args=(targets, begun), daemon=True) for _ in range(WORKERS)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()

    def _work(self, targets: Sequence[Target], begun: float) -> None:
        with contextlib.ExitStack() as stack:
            reporter = stack.enter_context(_Reporter())
            while not self._ended.is_set():
                with self._lock:
                    number, self._next = self._next, self._next + 1
                if number >= self._calls:
                    return
                self._ended.wait(max(0.0, begun + number * self._seconds / self._calls - time.monotonic()))
                chance = random.Random(self._seed * self._calls + number)
                target = chance.choice(targets)
                self._make(chance.choice(KINDS), target, chance)
                if chance.random() < REPORTS:
                    self._count('report', reporter.send(target, chance))

    def _make(self, kind: 'Kind', target: Target, chance: random.Random) -> None:
        begun = time.monotonic()
        try:
            answer = kind(target, chance)
            granted: Optional[bool] = isinstance(answer, list) and bool(answer) and answer[0] == 1
        except (OSError, xmlrpc.client.Error, ValueError, ArithmeticError):
            granted = None
        except Exception as error:      # http.client's, expat's: no answer either
            granted = None
            if not type(error).__module__.startswith(('http.', 'xml.')):
                raise
        self._count(kind.__name__, granted)
        with self._lock:
            self.slowest = max(self.slowest, time.monotonic() - begun)

    def _count(self, kind: str, granted: Optional[bool]) -> None:
        with self._lock:
            self.counts[kind] += 1
            if granted is not False:
                self.counts['%s, %s' % (kind, 'failed' if granted is None else 'granted')] += 1


def request_topic(target: Target, chance: random.Random) -> Any:
    """A request of a stream: in the name of one that has it or of anybody, to any place, in any size."""
    victims = [entry for entry in target.connections if entry[2] == 'o']
    topic, type_name = chance.choice(target.published)
    name, host, port = '/stranger_%d' % chance.randrange(10 ** 6), chance.choice(HOSTS), chance.randint(1, 65535)
    if victims and chance.random() < 0.5:
        _, name, _, _, topic, _, text = chance.choice(victims)[:7]
        place = REPORT.search(text)
        if place and chance.random() < 0.5:
            host, port = chance.choice((place.group(2), host)), chance.choice((int(place.group(3)), port))
    header = {'topic': topic, 'md5sum': '*', 'type': type_name, 'callerid': name}
    offer = chance.choice(([Request(host, port, header, chance.choice(SIZES)).params()], [['TCPROS']], [['UDPROS']],
                           [['UDPROS', b'\xff' * 20, host, port, 1472]]))
    return call(target.uri, 'requestTopic', name, topic, offer)


def publisher_update(target: Target, chance: random.Random) -> Any:
    """A topic has no publisher, or one that does not exist, in the master's name or in another."""
    topic = chance.choice(target.subscribed)[0]
    uris = ['http://127.0.0.1:%d/' % chance.randint(1, 65535) for _ in range(chance.choice((0, 0, 1, 3)))]
    return call(target.uri, 'publisherUpdate', chance.choice(('/master', '/stranger', target.uri)), topic, uris)


def bus_info(target: Target, chance: random.Random) -> Any:
    """A harmless call."""
    return call(target.uri, chance.choice(('getBusInfo', 'getBusStats', 'getPublications', 'getPid')), '/stranger')


def bad_call(target: Target, chance: random.Random) -> Any:
    """Methods that do not exist, and arguments that are not as they should be."""
    method = chance.choice(('requestTopic', 'publisherUpdate', 'paramUpdate', 'noSuchMethod', '_shutdown'))
    value: Any = chance.choice((None, 7, '', [], {'a': [1]}, [[]], 'x' * 10000, [['UDPROS', 1, 2, 3, 4]]))
    return call(target.uri, method, '/stranger', *chance.choice(((value,), (value, value), ('/a', value, value))))


def garbage(target: Target, chance: random.Random) -> Any:
    """Bytes that are not XML-RPC, or not all of it."""
    parsed = urllib.parse.urlparse(target.uri)
    data = chance.choice((
        b'GET / HTTP/1.1\r\n\r\n', b'POST /RPC2 HTTP/1.1\r\nContent-Length: 1000000\r\n\r\n<',
        b'POST / HTTP/1.1\r\nContent-Length: 20\r\nContent-Type: text/xml\r\n\r\n<methodCall><broken/>',
        bytes(chance.randrange(256) for _ in range(200))))
    with socket.create_connection((parsed.hostname or '', parsed.port or 0), TIMEOUT) as connection:
        connection.sendall(data)
        if chance.random() < 0.5:
            connection.shutdown(socket.SHUT_WR)
            connection.recv(100)


Kind = Callable[[Target, random.Random], Any]
KINDS: Sequence[Kind] = request_topic, request_topic, request_topic, publisher_update, publisher_update, bus_info, \
    bad_call, garbage


class _Reporter(contextlib.ExitStack):
    """Sends forged LinkReports to the port on which a node receives them.

    As root, from the address and port of a true reporter, so that only the connection id is guessed.
    """

    def __init__(self) -> None:
        super().__init__()
        self._plain = self.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        self._forger: Optional[Forger] = None
        with contextlib.suppress(PermissionError):
            self._forger = self.enter_context(Forger())

    def send(self, target: Target, chance: random.Random) -> Optional[bool]:
        """Send one; whether there was a place to send it to, None: it failed."""
        places = [REPORT.search(entry[6]) for entry in target.connections
                  if entry[2] == 'i' and entry[3] == 'UDPROS' and entry[4].endswith('/link/report')]
        place = chance.choice(places) if places else None
        if place is None:
            return False
        port, (host, source) = int(place.group(1)), (place.group(2), int(place.group(3)))
        streams = [topic.split('/')[-2] for topic, _ in target.published if topic.endswith('/segments')]
        payload = forged_report(streams, chance)
        to = urllib.parse.urlparse(target.uri).hostname or ''
        try:
            if self._forger is None:
                self._plain.sendto(payload, (to, port))
            else:
                self._forger.send((socket.gethostbyname(host), source), (socket.gethostbyname(to), port), payload)
        except OSError:
            return None
        return True


def forged_report(streams: Sequence[str], chance: random.Random) -> bytes:
    """A datagram with a LinkReport of random or old sequence numbers."""
    highest = chance.choice((1 << 32, 100000, 1000, 10))
    names = [name for name in streams if chance.random() < 0.5] or ['none']
    seqs = [chance.randrange(highest) for _ in names]
    message = LinkReport(
        session=chance.choice((1, chance.randrange(1 << 32))), clock=chance.randrange(1 << chance.choice((20, 40, 60))),
        streams=[StreamArrivals(name, seq, chance.randint(0, seq), chance.randint(0, 1500 * seq))
                 for name, seq in zip(names, seqs)],
        marks=[ArrivalMark(index, chance.randint(0, seq), chance.randrange(1 << chance.choice((10, 20, 32))))
               for index, seq in enumerate(seqs)])
    message.header.seq = chance.randrange(highest)
    buffer = io.BytesIO()
    message.serialize(buffer)
    data = buffer.getvalue()
    header = HEADER.pack(chance.randint(1, CONNECTION_IDS), Op.DATA0, chance.randint(1, 255), 1)
    return header + LENGTH.pack(len(data)) + data


def main(arguments: Sequence[str]) -> Dict[str, Any]:
    """Run a flood as the command line says; returns what is printed."""
    parser = argparse.ArgumentParser(description='Flood nodes with forged and senseless calls.')
    parser.add_argument('nodes', nargs='+', help='names of nodes that the master knows')
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--calls', type=int, default=10000)
    parser.add_argument('--seed', type=int, default=0)
    options = parser.parse_args(arguments)
    master = rosgraph.Master('/stranger')
    flood = HostileFlood([master.lookupNode(name) for name in options.nodes], options.seconds, options.calls,
                         options.seed)
    begun = time.monotonic()
    flood.run()
    return {'seconds': time.monotonic() - begun, 'slowest call [s]': flood.slowest, **flood.counts}


if __name__ == '__main__':
    print(json.dumps(main(sys.argv[1:]), sort_keys=True))
