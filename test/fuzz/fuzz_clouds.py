#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hostile chunks of point clouds, of all encodings, through the assembler.

    ./smokebot exec python3 test/fuzz/fuzz_clouds.py [SEGMENTS [SEED]]

Chunks of good clouds are mutated, dropped, repeated, mixed with those of other clouds and with random ones. Any
exception or warning is a fault, and so is a batch that takes more than MAX_TIME of processor time, a point that is not
finite, or a good cloud that is not shown whole afterwards. Prints what was refused, and by how much the memory of the
process grew.
"""
import collections
import pathlib
import sys
import time
import warnings
from random import Random
from typing import Any, Counter, List

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2]), str(pathlib.Path(__file__).resolve().parent)]
from fuzzing import run  # noqa: E402

from evaluation.offline_link import Sender, operator_side  # noqa: E402
from smokebot_udp.codecs.wire.cloud import MAX_POINTS  # noqa: E402
from smokebot_udp.msg import CloudChunk  # noqa: E402
from smokebot_udp.udpros.frame import Frame  # noqa: E402

MAX_TIME = 0.5
"""[s]"""

SEGMENTS = 1000000
COUNTS = 1, 2, 60, 700, 5000
"""Points of the good clouds."""

BEGINNING = 12
"""Most faults are made among this many of the first bytes of the data."""

VALUES = {
    'points': (0, 1, 2, 80, 65536, MAX_POINTS, MAX_POINTS + 1, 2 ** 32 - 1), 'chunks': (0, 1, 2, 3, 80, 65535),
    'index': (0, 1, 2, 65535), 'has_intensity': (0, 1, 255), 'is_double': (0, 1, 255),
    'step': (0.0, 1e-45, 0.025, 3e38, -1.0, np.inf, np.nan), 'origin': (0, -2 ** 31, 2 ** 31 - 1),
    'bits': (0, 1, 2, 6, 8, 18, 19, 20, 21, 255),
    'intensity_min': (0.0, np.nan, np.inf, 3e38), 'intensity_step': (0.0, np.nan, -np.inf, 3e38)}
"""{field: values that the segments of a batch are given alike: they still have one head}"""

CODES = bytes.fromhex('0211' '0211' '0211'), bytes.fromhex('0211' '0211'), bytes.fromhex('0110' '0110'), bytes(
    [58] + 29 * [0x66]) * 2, bytes([40] + 20 * [0xff]) * 3
"""Codes with short words, with words for all classes, and with mostly no word."""


def clouds() -> List[Any]:
    """The segments of good clouds: (chunks,) structured arrays."""
    found, random = [], np.random.RandomState(1)
    for count in COUNTS:
        values = random.normal(0, 3, (count, 4)).astype('<f4')
        values[:, 2] = np.round(values[:, 2])
        message = PointCloud2(height=1, width=count, point_step=16, row_step=values.nbytes, data=values.tobytes(),
                              fields=[PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(
                                  ('x', 'y', 'z', 'intensity'))])
        message.header.frame_id = 'velodyne'
        for encoding in ('float32', 'packed', 'sorted', 'sorted', 'sorted'):
            for intensity in (False, True):
                frame, = Sender('cloud', leaf_size=0.0, encoding=encoding, intensity=intensity).frames(message)
                found.append(frame.records.copy())     # without the datagrams' headers in between
    return found


class Fuzzer:
    """Feeds batches of segments to an assembler.

    :param random: of all that is random
    """

    def __init__(self, random: Random) -> None:
        self._random, self._numpy = random, np.random.RandomState(random.randrange(1 << 30))
        self._clouds = clouds()
        self._assembler, self._settings = operator_side('cloud')
        self._now, self._stamp = 100.0, 1
        self.inputs = self.shown = self.points = 0
        self.worst = 0.0
        """Longest processor time of a batch [s]."""

    @property
    def dropped(self) -> Counter[str]:
        """Refused segments, by reason."""
        return collections.Counter(self._assembler.dropped)

    def report(self) -> str:
        """What was shown and refused."""
        return '%d clouds shown; refused: %s' % (self.shown, dict(self.dropped))

    def good(self) -> None:
        """Feed the good clouds.

        :raises AssertionError: one of them is not shown whole
        """
        for records in self._clouds:
            self._now, self._stamp = self._now + 1, self._stamp + 1
            self._take()    # what was in progress
            before = self.points
            self._feed(records.copy(), np.ones(len(records), bool))
            assert self.points - before == records['points'][0], records[:1]

    def batch(self) -> None:
        """Feed one batch of others."""
        random = self._random
        records = self._random_segments() if random.random() < 0.1 else self._mutated()
        self._now += random.choice((0.0, 0.001, 0.03, 0.3, 1.0))
        self._stamp += random.random() < 0.7
        begun = time.process_time()
        self._feed(records, self._numpy.random_sample(len(records)) < 0.95)
        self.worst = max(self.worst, time.process_time() - begun)
        self.inputs += len(records)

    def _feed(self, records: Any, mask: Any) -> None:
        records['header']['stamp']['secs'], records['header']['stamp']['nsecs'] = self._stamp, 5
        self._assembler.receive(records, mask, self._now)
        self._take()

    def _take(self) -> None:
        finished = self._assembler.poll(self._now)
        while finished is not None:
            assembled = self._assembler.assemble(finished, self._settings, False, self._now)
            if assembled is not None:
                message = assembled.message
                size = 3 * (8 if message.fields[0].datatype == PointField.FLOAT64 else 4)
                values = np.frombuffer(message.data, np.uint8).reshape(message.width, message.point_step)[:, :size]
                assert np.isfinite(np.ascontiguousarray(values).view('<f%d' % (size // 3))).all()
                self.shown, self.points = self.shown + 1, self.points + message.width
            finished = self._assembler.poll(self._now)

    def _mutated(self) -> Any:
        """Some segments of a cloud, most of them with faults."""
        random = self._random
        good = random.choice(self._clouds)
        chosen = self._numpy.randint(0, len(good), random.randint(1, 2 * len(good)))
        records = good[np.unique(chosen) if random.random() < 0.5 else chosen]
        if random.random() < 0.1 and records['data'].shape[1] > 1:
            records = self._shortened(records)
        for _ in range(random.choice((0, 1, 1, 1, 2, 3))):
            self._spoil(records)
        return records

    def _shortened(self, records: Any) -> Any:
        """The segments with less data."""
        size = self._random.randrange(records['data'].shape[1])
        short = empty(len(records), records['codes'].shape[1], size)
        for field in records.dtype.names:
            if field not in ('header', 'data') and field in short.dtype.names:
                short[field] = records[field]
        short['data'] = records['data'][:, :size]
        return short

    def _spoil(self, records: Any) -> None:
        """Make faults in any bytes, in the head, in the codes or in the data."""
        random, fault = self._random, self._random.random()
        if fault < 0.3:
            rows = records.view(np.uint8).reshape(len(records), -1)
            for _ in range(random.choice((1, 1, 3, 20))):
                which: Any = slice(None) if random.random() < 0.5 else random.randrange(len(records))
                rows[which, random.randrange(rows.shape[1])] = self._byte()
        elif fault < 0.6 and records['data'].shape[1]:
            size = records['data'].shape[1]
            for _ in range(random.choice((1, 2, 10, 100))):
                at = random.randrange(min(BEGINNING, size) if random.random() < 0.5 else size)
                records['data'][random.randrange(len(records)), at] = self._byte()
        elif fault < 0.7:
            records['data'] = self._numpy.randint(0, random.choice((2, 256)), records['data'].shape)
        elif fault < 0.85 and records['codes'].shape[1]:
            records['codes'][:, random.randrange(records['codes'].shape[1])] = self._byte()
        else:
            field = random.choice(list(VALUES))
            records[field] = random.choice(VALUES[field])

    def _byte(self) -> int:
        return self._random.choice((0, 1, 127, 255, self._random.randrange(256)))

    def _random_segments(self) -> Any:
        """Segments with data of any length, with likely and unlikely values."""
        random = self._random
        codes = random.choice((b'', *CODES, self._numpy.bytes(random.randrange(1, 40))))
        records = empty(random.randint(1, 30), len(codes), random.randrange(1300))
        rows = records.view(np.uint8).reshape(len(records), -1)
        if random.random() < 0.2:
            rows[:] = self._numpy.randint(0, 256, rows.shape)
            return records
        records['codes'] = list(codes)
        for field, values in VALUES.items():
            records[field] = random.choice(values)
        records['step'], records['bits'] = 0.025, random.choice((0, 2, 8, 18))
        records['points'], records['chunks'] = random.choice((30, 3000, 65535, MAX_POINTS)), random.choice((1, 30, 600))
        records['index'] = np.arange(len(records)) % random.choice((30, 31))
        records['data'] = self._numpy.randint(0, random.choice((1, 2, 256)), records['data'].shape)
        return records


def empty(count: int, codes: int, size: int) -> Any:
    """(count,) empty records."""
    return Frame(CloudChunk, count, {'header.frame_id': 8, 'codes': codes, 'data': size}).records.copy()


if __name__ == '__main__':
    warnings.simplefilter('error')
    count, seed = [int(argument) for argument in sys.argv[1:]] + [SEGMENTS, 1][len(sys.argv) - 1:]
    sys.exit(run(Fuzzer(Random(seed)), count, MAX_TIME))
