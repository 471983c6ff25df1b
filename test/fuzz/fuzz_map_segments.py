#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
r"""Hostile segments of maps in tiles, through the operator's assembler and the decoder.

    NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(mktemp -d) ./smokebot exec python3 test/fuzz/fuzz_map_segments.py \
        [SEGMENTS [SEED]]

As fuzz_layered.py. Segments of good maps that grow and move, of several sessions, are mutated, dropped, repeated and
mixed with random ones. Any exception is a fault, and so is a batch that takes more than MAX_TIME of processor time, or
a good map that is not shown exactly afterwards.
"""
import collections
import pathlib
import sys
import time
from random import Random
from typing import Any, Counter, List

import numpy as np

TOP = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(TOP), str(TOP / 'test' / 'unit'), str(TOP / 'test' / 'fuzz')]
from fuzzing import run  # noqa: E402
from tile_sender import TileSender, info_of  # noqa: E402

from evaluation.offline_link import operator_side, work_off  # noqa: E402
from smokebot_udp.codecs.tiles.rectangle import Rectangle  # noqa: E402
from smokebot_udp.msg import MapTile  # noqa: E402
from smokebot_udp.streams.segments import TILES  # noqa: E402
from smokebot_udp.udpros.frame import Frame  # noqa: E402

MAX_TIME = 0.3
"""[s]"""

SEGMENTS = 1000000
SESSIONS = 4
NUMBERS = 0, 1, 2, 60, 127, 128, 255, (1 << 31) - 1
SIDES = 0, 1, 3, 16, 300, 512, 4096, 65535
FIELDS = 'revision', 'shift', 'session', 'current', 'place', 'size', 'corner'


def cells_of(random: np.random.RandomState, height: int, width: int) -> Any:
    """(height, width) int8: walls, free cells, unknown ones and some of all values."""
    cells = np.full((height, width), -1, np.int8)
    cells[height // 8:, width // 8:] = 0
    cells[::17], cells[:, ::23] = 100, 100
    noisy = random.random_sample(cells.shape) < 0.03
    cells[noisy] = random.randint(-1, 101, np.count_nonzero(noisy))
    return cells


class Fuzzer:
    """Feeds batches of segments to an assembler.

    :param random: of all that is random
    """

    def __init__(self, random: Random) -> None:
        self._random, self._numpy = random, np.random.RandomState(random.randrange(1 << 30))
        self._senders = [TileSender(session, 150) for session in range(SESSIONS)]
        self._maps: List[List[Any]] = [[] for _ in self._senders]      # records of the newest maps of each
        self._assembler, self._settings = operator_side('grid', rate=50.0)
        self._now = 100.0
        self.inputs = self.shown = 0
        self.worst = 0.0
        """Longest processor time of a batch [s]."""
        for number in range(SESSIONS):
            self._change(number)

    @property
    def dropped(self) -> Counter[str]:
        """Refused segments, by reason."""
        return collections.Counter(self._assembler.dropped)

    def report(self) -> str:
        """What was shown and refused."""
        return '%d maps shown; refused: %s' % (self.shown, dict(self.dropped))

    def good(self) -> None:
        """Feed a good map, twice.

        :raises AssertionError: it is not shown
        """
        sender = TileSender(self._random.randrange(1 << 32), 150)
        cells = cells_of(self._numpy, 90, 120)
        tiles = sender.update(cells, info_of(cells, (self._random.randrange(100) / 20, 0.0)))
        for records in (tiles, [sender.beat()], tiles, [sender.beat()], tiles):
            for record in records:
                self._receive(record)
            self._now += 2.0
        message = self._take()
        assert message is not None and np.array_equal(
            message.data.reshape(message.info.height, message.info.width), cells), sender.source

    def batch(self) -> None:
        """Feed one batch of others."""
        random = self._random
        if random.random() < 0.01:
            self._change(random.randrange(SESSIONS))
        # most segments of a batch are of one sender: otherwise hardly any map would begin
        good = random.choice(self._maps)
        self._now += random.choice((0.0, 0.001, 0.03, 0.3, 1.1))
        begun = time.process_time()
        for _ in range(random.randint(1, 30)):
            record = random.choice(good if random.random() < 0.95 else random.choice(self._maps))
            record = self._random_segment(record) if random.random() < 0.1 else record.copy()
            for _ in range(random.choice((0, 1, 1, 2, 3))):
                self._spoil(record)
            self._receive(record)
        self._take()
        self._assembler.ages(self._now)
        self._assembler.holding()
        self.worst = max(self.worst, time.process_time() - begun)

    def _change(self, number: int) -> None:
        """Make another map of a sender, which may have grown or moved."""
        sender = self._senders[number]
        cells = cells_of(self._numpy, self._random.choice((1, 40, 90, 200)), self._random.choice((1, 33, 120, 400)))
        origin = self._random.choice((0.0, 0.0, -0.5, 3.2, 0.013)), self._random.choice((0.0, -7.0))
        tiles = sender.update(cells, info_of(cells, origin), self._random.choice(('map', 'map', 'odom')))
        made = tiles + sender.overview() + [sender.beat(), sender.beat([Rectangle(0, 0, 30, 20)])]
        self._maps[number] = self._maps[number][-20:] + made

    def _receive(self, record: Any) -> None:
        self._assembler.receive(record, np.ones(1, bool), self._now, TILES)
        if self._random.random() < 0.5:
            work_off(self._assembler)
        self.inputs += 1

    def _take(self) -> Any:
        """The newest message, if there is any."""
        work_off(self._assembler)
        finished, message = self._assembler.poll(self._now), None
        while finished is not None:
            assembled = self._assembler.assemble(finished, self._settings, False, self._now)
            message = message if assembled is None else assembled.message
            self.shown += assembled is not None
            finished = self._assembler.poll(self._now)
        return message

    def _spoil(self, record: Any) -> None:
        """Make faults in any bytes, in the fields or in the data."""
        random, fault = self._random, self._random.random()
        if fault < 0.35:
            row = record.view(np.uint8)
            for _ in range(random.choice((1, 1, 3, 20))):
                row[random.randrange(len(row))] = random.randrange(256)
        elif fault < 0.6 and record['data'].size:
            record['data'][0, random.randrange(record['data'].shape[1])] ^= random.choice((1, 2, 64, 255))
        elif fault < 0.7:
            record['data'] = self._numpy.randint(0, 256, record['data'].shape)
        elif fault < 0.9:
            record[random.choice(FIELDS)] = np.int64(random.choice(NUMBERS))
        else:
            record['header']['seq'] = random.randrange(1 << 32)

    def _random_segment(self, good: Any) -> Any:
        """A segment of any length and any values, with the head of a good one."""
        random = self._random
        record = Frame(MapTile, 1, {'header.frame_id': 3, 'pending': random.choice((0, 0, 1, 4, 80)),
                                    'data': random.choice((0, 1, 2, 60, 1300))}).records.copy()
        if random.random() < 0.3:
            record.view(np.uint8)[:] = self._numpy.randint(0, 256, record.itemsize)
            return record
        for name in ('info', 'corner', 'session'):
            record[name] = good[name]
        record['header']['frame_id'] = list(b'map')
        record['revision'], record['shift'] = random.choice((1, 5, 500, 1 << 31)), random.choice((0, 0, 1, 2, 12))
        record['place'] = [self._numpy.randint(-150, 150), self._numpy.randint(-150, 150)]
        record['size'] = [random.choice(SIDES), random.choice(SIDES)]
        if random.random() < 0.3:
            record['info']['width'], record['info']['height'] = random.choice(SIDES), random.choice(SIDES)
        if record['data'].size:
            record['data'] = self._numpy.randint(0, 256, record['data'].shape)
            record['data'][0, 0] = random.choice((0, 101, 102, 103, 104))
        return record


if __name__ == '__main__':
    count, seed = [int(argument) for argument in sys.argv[1:]] + [SEGMENTS, 1][len(sys.argv) - 1:]
    sys.exit(run(Fuzzer(Random(seed)), count, MAX_TIME))
