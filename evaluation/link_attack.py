# SPDX-License-Identifier: BSD-3-Clause
"""A stranger on the network of a link: bad datagrams between good ones, at a steady rate.

    python3 -m evaluation.link_attack --to 10.77.0.1:17001 [--count 1000000] [--rate 20000] [--half-open 10000]

It runs on the side of its target. It sees all that passes on the link, and sends from any address, that of the true
peer among them. It has no key. It obeys lines on its standard input: `record SECONDS`, `replay`, `flood`,
`half-open`; each is answered by a line of JSON with the number of datagrams by kind.
"""
import argparse
import collections
import json
import os
import random
import subprocess
import sys
import time
from typing import Callable, Counter, Dict, Iterator, List, Sequence, Tuple

from smokebot_udp.link.operator_core import OperatorCore
from smokebot_udp.link.packets import Kind
from smokebot_udp.link.place import place_at
from smokebot_udp.link_lab.lab import DEVICE

from .forged_packets import Address, Forger
from .link_pair import MAX_DATAGRAM_SIZE, received
from .tap import LOOPBACK, datagrams, open_tap

PERIOD = 0.005
"""Interval between bursts [s]."""

STRANGERS = '10.78.%d.%d'
STRANGERS_NETWORK = '10.78.0.0/16'

BYTES = 0, 1, 2, 127, 128, 255

BATCH = 100
"""Strangers at a time that begin a handshake."""

TIMEOUT = 0.1
"""While nothing passes, the time is looked at this often [s]."""

ANSWER_TIME = 0.5
"""Who has no answer for this long gets none [s]."""

KEY_SIZE = 32

Forged = Tuple[Address, bytes]
"""Source and payload."""


def stranger(number: int) -> Address:
    """The address of a stranger, 0..65535."""
    return STRANGERS % divmod(number, 256), 1024 + number % 60000


class Attack:
    """Makes bad datagrams of good ones.

    :param genuine: datagrams that the target got, with their sources; not empty
    :param own: those that it sent, with where they went
    """

    def __init__(self, genuine: Sequence[Forged], own: Sequence[Forged], chance: random.Random) -> None:
        self._genuine, self._own, self._chance = genuine, own, chance
        self._kinds: Dict[str, Callable[[], Forged]] = {
            'random': self._random, 'mutated': self._mutated, 'cut or extended': self._resized,
            'replayed': self._replayed, 'replayed by a stranger': self._moved, 'forged data': self._forged_data,
            'reflected': self._reflected}
        self._names = list(self._kinds)

    def next(self) -> Tuple[str, Forged]:
        """(kind, what is sent)."""
        name = self._chance.choice(self._names)
        return name, self._kinds[name]()

    def _random(self) -> Forged:
        size = self._chance.choice((0, 1, 4, 8, 16, 100, MAX_DATAGRAM_SIZE))
        data = bytes([self._chance.randrange(10)]) + os.urandom(size) if size else b''
        return self._somebody(), data

    def _mutated(self) -> Forged:
        source, payload = self._chance.choice(self._genuine)
        data = bytearray(payload)
        for _ in range(self._chance.randint(1, 4)):
            # most of what is checked is at the begin
            at = self._chance.randrange(self._chance.choice((min(len(data), 32), len(data))))
            data[at] = self._chance.choice((*BYTES, data[at] ^ 1 << self._chance.randrange(8)))
        return source, bytes(data)

    def _resized(self) -> Forged:
        source, data = self._chance.choice(self._genuine)
        if self._chance.random() < 0.5:
            return source, data[:self._chance.randrange(len(data))]
        return source, data + os.urandom(self._chance.randint(1, 100))

    def _replayed(self) -> Forged:
        return self._chance.choice(self._genuine)

    def _reflected(self) -> Forged:
        return self._chance.choice(self._own)

    def _moved(self) -> Forged:
        return self._somebody(), self._chance.choice(self._genuine)[1]

    def _forged_data(self) -> Forged:
        """The right kind and index, a counter to come, and a body that is not sealed."""
        source, data = self._chance.choice(self._genuine)
        counter = self._chance.choice((1, 1 << 10, 1 << 30, 1 << 63)) + self._chance.randrange(1000)
        return source, data[:8] + counter.to_bytes(8, 'little') + os.urandom(max(0, len(data) - 16))

    def _somebody(self) -> Address:
        return stranger(self._chance.randrange(1 << 16))


def record(to: Address, device: str, seconds: float) -> Tuple[List[Forged], List[Forged]]:
    """What the target gets from the link within a time, and what it sends."""
    end = time.monotonic() + seconds
    got: List[Forged] = []
    sent: List[Forged] = []
    with open_tap(device) as tap:
        while time.monotonic() < end:
            for datagram in datagrams(tap, to[1], TIMEOUT):
                if datagram.to == to and datagram.payload:
                    got.append((datagram.source, datagram.payload))
                elif datagram.source == to and datagram.payload:
                    sent.append((datagram.to, datagram.payload))
                if time.monotonic() > end:
                    break
    return got, sent


def flood(to: Address, attack: Attack, count: int, rate: float) -> Counter[str]:
    """Send bad datagrams; how many of each kind, `failed` among them.

    :param rate: [1/s]
    """
    counts: Counter[str] = collections.Counter()
    begun = time.monotonic()
    with Forger() as forger:
        for number in range(count):
            name, (source, payload) = attack.next()
            counts[name] += 1
            send(forger, source, to, payload, counts)
            ahead = begun + number / rate - time.monotonic()
            if ahead > PERIOD:
                time.sleep(ahead)
    counts['rate [1/s]'] = round(count / (time.monotonic() - begun))
    return counts


def replay(to: Address, genuine: Sequence[Forged], kind: Kind) -> Counter[str]:
    """Send all recorded datagrams of a kind again, from the addresses that they came from."""
    counts: Counter[str] = collections.Counter()
    with Forger() as forger:
        for source, payload in genuine:
            if payload[0] == kind:
                counts[kind.name] += 1
                send(forger, source, to, payload, counts)
    return counts


def send(forger: Forger, source: Address, to: Address, payload: bytes, counts: Counter[str]) -> None:
    """Send a datagram, and count it where it cannot leave."""
    try:
        forger.send(source, to, payload)
    except OSError:
        counts['failed'] += 1


class Stranger:
    """Begins a handshake, answers the cookie, and falls silent.

    :param key: a wrong one
    """

    def __init__(self, number: int, key: bytes, to: Address) -> None:
        self.address = stranger(number)
        self._core = OperatorCore(key, os.urandom, MAX_DATAGRAM_SIZE, 'stranger')
        self._core.set_places([place_at(to)], 0.0)
        self._now = 0.0

    def sent(self) -> List[bytes]:
        """What it sends now."""
        return [payload for _, payload in self._core.outputs()]

    def get(self, source: Address, payload: bytes) -> None:
        """Take an answer."""
        self._now += 0.01
        self._core.receive(*received([(source, payload)]), self._now)


def half_open(to: Address, count: int) -> Counter[str]:
    """Begin handshakes in the name of as many strangers; the datagrams by kind: theirs, and `answers` by kind."""
    counts: Counter[str] = collections.Counter()
    key = os.urandom(KEY_SIZE)
    with Forger() as forger, open_tap(LOOPBACK) as tap:
        for start in range(0, count, BATCH):
            strangers = {each.address: each for each in (
                Stranger(number, key, to) for number in range(start, min(start + BATCH, count)))}
            for each in strangers.values():
                speak(forger, each, to, counts)
            converse(forger, strangers, datagrams(tap, to[1], ANSWER_TIME), to, counts)
    return counts


def speak(forger: Forger, who: Stranger, to: Address, counts: Counter[str]) -> None:
    """Send what a stranger has to send."""
    for payload in who.sent():
        counts[Kind(payload[0]).name] += 1
        send(forger, who.address, to, payload, counts)


def converse(forger: Forger, strangers: Dict[Address, Stranger], answers: Iterator, to: Address,
             counts: Counter[str]) -> None:
    """Let strangers answer, until each has sent its INIT or nobody is answered any more."""
    waiting = set(strangers)
    for answer in answers:
        if answer.source != to or answer.to not in strangers:
            continue
        counts['answer ' + Kind(answer.payload[0]).name] += 1
        if answer.to in waiting:
            waiting.remove(answer.to)
            strangers[answer.to].get(answer.source, answer.payload)
            speak(forger, strangers[answer.to], to, counts)
        if not waiting:
            return


def allow_strangers(host: str) -> None:
    """Let answers of a host to strangers leave, so that the tap sees them."""
    subprocess.run(['ip', 'route', 'replace', STRANGERS_NETWORK, 'dev', LOOPBACK, 'src', host], check=True)


def main(arguments: Sequence[str]) -> None:
    """Obey standard input."""
    parser = argparse.ArgumentParser(description='Attack an end of a link.')
    parser.add_argument('--to', required=True, metavar='HOST:PORT')
    parser.add_argument('--count', type=int, default=10 ** 6)
    parser.add_argument('--rate', type=float, default=20000.0, help='datagrams a second')
    parser.add_argument('--half-open', type=int, default=10 ** 4)
    parser.add_argument('--device', default=DEVICE, help='of the link')
    parser.add_argument('--seed', type=int, default=0)
    options = parser.parse_args(arguments)
    host, port = options.to.split(':')
    to = host, int(port)
    genuine: List[Forged] = []
    own: List[Forged] = []
    allow_strangers(host)
    print('ready', flush=True)
    for line in sys.stdin:
        word, *rest = line.split()
        if word == 'record':
            got, sent = record(to, options.device, float(rest[0]))
            genuine += got
            own += sent
            answer = collections.Counter(str(payload[0]) for _, payload in genuine)
        elif word == 'replay':
            answer = replay(to, genuine, Kind.INIT)
        elif word == 'flood':
            answer = flood(to, Attack(genuine, own, random.Random(options.seed)), options.count, options.rate)
        else:
            answer = half_open(to, options.half_open)
        print(json.dumps(answer), flush=True)


if __name__ == '__main__':
    main(sys.argv[1:])
