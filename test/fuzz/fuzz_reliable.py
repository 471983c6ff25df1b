#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A hostile peer of reliable channels.

    ./smokebot exec python3 test/fuzz/fuzz_reliable.py [SEGMENTS [SEED]]

A robot and an operator exchange messages. A stranger sends segments of random fields in the operator's name, and
repeats those that were sent. A hostile insider knows the sessions, and changes segments. Faults are: any exception; a
batch that takes more than MAX_TIME of processor time; more than MAX_ANSWERS answers to it; fields that do not fit a
message; but for the insider, a message that is delivered twice, out of order, or was never sent; and, after the insider
has gone, a new operator whose message does not arrive.
"""
import pathlib
import sys
import time
from random import Random
from typing import Any, Dict, List

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / 'unit'), str(pathlib.Path(__file__).resolve().parent)]
from fuzzing import run  # noqa: E402
from reliable_sides import DOWN, UP, Link  # noqa: E402

from smokebot_udp.reliable.bounds import Bounds  # noqa: E402
from smokebot_udp.reliable.segment import MAX_NUMBER, Segment  # noqa: E402

MAX_TIME = 2.0
"""Maximum processor time of a batch [s]."""
MAX_ANSWERS = 400
"""Maximum number of answers to a batch."""
SEGMENTS = 500000
BATCH = 200
SIZES = 0, 1, 15, 16, 17, 1300
SMALL = 0, 1, 2, 3, 200, 255, 256, 257, 300, MAX_NUMBER
SILENCES = 0.001, 0.05, 0.3, 2.0
CHANNELS = {UP: {'bounds': Bounds(100, 20000, 5.0)}, DOWN: {'ordered': False, 'bounds': Bounds(100, 20000, 5.0)}}


class World:
    """A link, and somebody in the operator's name.

    :param insider: whether that one knows the sessions
    """

    def __init__(self, insider: bool, random: Random) -> None:
        self.insider, self._random = insider, random
        self.link = Link(random.randrange(1 << 30), loss=0.1, jitter=0.02, channels=CHANNELS)
        self.link.run(2.0)
        self.count = 0

    def forged(self, to: str) -> Segment:
        """A segment of random fields, or one of those that were sent; the insider changes these."""
        genuine = [segment for name, segment in self.link.seen[-300:] if name == to]
        repeats = bool(genuine) and self._random.random() < 0.5
        if repeats and not self.insider:
            return self._random.choice(genuine)
        if not repeats:
            segment = Segment(**{name: self._value(name) for name in Segment._fields})
        else:
            segment = self._random.choice(genuine)
            for name in self._random.sample(Segment._fields, self._random.choice((0, 1, 1, 2))):
                segment = segment._replace(**{name: self._value(name)})
        known = {'session': genuine[-1].session, 'peer': genuine[-1].peer} if self.insider and genuine else {}
        return segment._replace(**known)

    def _value(self, name: str) -> Any:
        if name in ('data', 'received'):
            return self._random.getrandbits(8 * 1300).to_bytes(1300, 'little')[:self._random.choice(SIZES)]
        if name == 'channel':
            return self._random.choice((UP, DOWN, 0, self._random.getrandbits(32)))
        if name == 'kind':
            return self._random.choice((0, 1, 2, 3, 4, 5, 255))
        value = self._random.choice((*SMALL, self._random.getrandbits(32)))
        return value & 0xffff if name in ('part', 'parts') else value

    def attack(self) -> None:
        """A batch of forged segments among messages of both."""
        for to in ('robot', 'desk'):
            sent = self.link.sent
            for _ in range(BATCH // 2):
                self.link.deliver(to, self.forged(to))
            for channel in (UP, DOWN):
                self.count += 1
                self.link.send(channel, b'%09d' % self.count + bytes(self._random.choice((0, 5000))))
            self.link.run(self._random.choice(SILENCES))
            assert self.link.sent - sent < MAX_ANSWERS, self.link.sent - sent
        del self.link.seen[:-1000]

    def check(self) -> None:
        """What was delivered was sent, once, in order."""
        for channel, got in ((UP, self.link.robot.got[UP]), (DOWN, self.link.desk.got[DOWN])):
            numbers = [int(message[:9]) for message in got]
            assert len(numbers) == len(set(numbers)) and all(number <= self.count for number in numbers)
            assert channel == DOWN or numbers == sorted(numbers)

    def renew(self) -> None:
        """The insider has gone, and a new operator comes."""
        self.link.restart('desk')
        self.link.run(15.0)
        self.count += 1
        self.link.send(UP, b'%09d' % self.count)
        self.link.run(5.0)
        assert self.link.robot.got[UP][-1:] == [b'%09d' % self.count], self.link.robot.peers.counts()


class Fuzzer:
    """Feeds segments to both sides of several worlds.

    :param random: of all that is random
    """

    def __init__(self, random: Random) -> None:
        self._random = random
        self.worlds: Dict[str, World] = {'stranger': World(False, random), 'insider': World(True, random)}
        self.inputs, self.worst = 0, 0.0

    def report(self) -> str:
        """What was dropped, by reason."""
        return '; '.join('%s: %s' % (name, dict(world.link.robot.peers.counts()))
                         for name, world in self.worlds.items())

    def good(self) -> None:
        """A new operator is served in each world."""
        for world in self.worlds.values():
            world.renew()

    def batch(self) -> None:
        """Feed some to a world."""
        world = self._random.choice(list(self.worlds.values()))
        begun = time.process_time()
        world.attack()
        self.inputs += BATCH
        if not world.insider:
            world.check()
        if self._random.random() < 0.05:
            world.renew()
        self.worst = max(self.worst, time.process_time() - begun)


def arguments(given: List[str]) -> List[int]:
    return [int(argument) for argument in given] + [SEGMENTS, 1][len(given):]


if __name__ == '__main__':
    count, seed = arguments(sys.argv[1:])
    sys.exit(run(Fuzzer(Random(seed)), count, MAX_TIME))
