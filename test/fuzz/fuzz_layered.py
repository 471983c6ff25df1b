#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hostile segments of layered images, through the assembler, the restorer and the decoder.

    NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(mktemp -d) ./smokebot exec python3 test/fuzz/fuzz_layered.py [SEGMENTS [SEED]]

The environment makes numba's loops check their indexes; without a cache of its own they would be taken from one without
checks. Segments of good images are mutated, dropped, repeated, mixed with those of other images and with random ones.
Any exception is a fault, and so is a batch that takes more than MAX_TIME of processor time, or a good image that is not
shown afterwards. Prints what was refused, and by how much the memory of the process grew.
"""
import collections
import pathlib
import sys
import time
from random import Random
from typing import Any, Counter, List, NamedTuple, Tuple

import numpy as np

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2]), str(pathlib.Path(__file__).resolve().parent)]
from fuzzing import run  # noqa: E402

from evaluation.offline_link import operator_side  # noqa: E402
from smokebot_udp.codecs.layered import motion  # noqa: E402
from smokebot_udp.codecs.layered.image import encode, read  # noqa: E402
from smokebot_udp.codecs.layered.pieces import GROUP, Layer, Plan, protect  # noqa: E402
from smokebot_udp.codecs.layered.plan import best_plan, worth  # noqa: E402
from smokebot_udp.msg import LayeredSegment  # noqa: E402
from smokebot_udp.streams.image.pixel_layers import CodedShape  # noqa: E402
from smokebot_udp.streams.image.references import CodedImage, ends_of, with_motion  # noqa: E402
from smokebot_udp.streams.segments import LAYERS  # noqa: E402
from smokebot_udp.udpros.frame import Frame  # noqa: E402

MAX_TIME = 0.2
"""[s]"""

SEGMENTS = 5000000
SHAPES = ((1, 1), (1, 70), (33, 2), (48, 64), (48, 64, 3), (61, 83))
LARGE, RARELY = (480, 640), 0.002
"""Its turn comes with this probability: decoding it takes a hundred times as long."""

LONG = 17 * GROUP
"""Datagrams of the longest image: as many codes as there may be."""

ENCODINGS = {(2, 1): b'mono8', (2, 2): b'mono16', (3, 1): b'bgr8'}
"""{(dimensions, itemsize): encoding}"""

FIELDS = ('height', 'width', 'count', 'index', 'errors', 'sizes', 'depth_unit', 'is_bigendian', 'session', 'picture',
          'reference', 'reference_layers', 'checksum')
VALUES = 0, 1, 2, 5, 12, 40, 64, 240, 241, 255
"""That the segments of a batch are given alike: they still have one head."""


class Image(NamedTuple):
    """An image."""
    records: Any
    """Its segments."""
    data: bytes
    """Its stream."""
    shape: Tuple[int, int, int, int]
    """As decode takes it."""


def frame_of(count: int, layers: int, size: int, encoding: bytes) -> Any:
    """(count,) empty records."""
    return Frame(LayeredSegment, count, {
        'header.frame_id': 6, 'encoding': len(encoding), 'thresholds': layers, 'sizes': layers, 'errors': layers,
        'data': size}).records.copy()     # without the datagrams' headers in between


def image_of(shape: Any, item: int, lossless: bool, seed: int, with_classes: bool = False) -> Image:
    """A random image, well protected."""
    random = np.random.RandomState(seed)
    smooth = np.add.outer(np.sin(np.arange(shape[0]) / 9.0), np.cos(np.arange(shape[1]) / 7.0)) * 30 + 100
    pixels = (smooth.reshape(shape[:2] + (1,) * (len(shape) - 2)) * (1 if item == 1 else 100)
              + random.randint(0, 20, shape)).astype('u%d' % item)
    classes = random.randint(0, 4, shape[:2]).astype(np.uint8) if with_classes else None
    stream = encode(pixels, lossless, 40000, classes)
    plan = best_plan(stream.ends, worth(stream.errors, stream.cells, 0.065), 2 * len(stream.data) + 400,
                     {0.05: 0.5, 0.5: 0.5}, None, 100, random.randint(100, 1300))
    encoding = b'32FC1' if with_classes else ENCODINGS[len(shape), item]
    return Image(records_of(stream.data, plan, shape, encoding), stream.data,
                 (shape[0], shape[1], shape[2] if len(shape) == 3 else 1, item))


def pair_of(shape: Any, item: int, lossless: bool, session: int) -> List[Image]:
    """An image, and one that is predicted from it and moves."""
    first = image_of(shape, item, lossless, session)
    count = len(first.records)
    layers = [Layer(*layer) for layer in zip(*(first.records[name][0].tolist() for name in ('thresholds', 'sizes')))]
    found = read(first.data, *first.shape)
    assert found is not None
    coded = CodedImage(CodedShape(*first.shape), found.prefixes, ends_of(layers, count))
    reference = coded.reference(len(layers))
    assert reference is not None
    pixels = np.ascontiguousarray(np.roll(reference.pixels, 2, axis=1))
    moved = motion.estimate(reference.pixels, pixels)
    stream = encode(pixels, lossless, 40000, None, motion.compensate(reference.pixels, moved))
    data = with_motion(motion.to_bytes(moved), stream.data)
    plan = best_plan(stream.ends + len(data) - len(stream.data), worth(stream.errors, stream.cells, 0.065),
                     2 * len(data) + 400, {0.05: 0.5, 0.5: 0.5}, None, 100, 1000)
    second = Image(records_of(data, plan, shape, ENCODINGS[len(shape), item]), data, first.shape)
    for image, number in ((first, 0), (second, 1)):
        image.records['session'], image.records['picture'] = session, number
    second.records['reference_layers'], second.records['checksum'] = len(layers), reference.checksum
    return [first, second]


def noise() -> Image:
    """The longest image: noise of 16 bits, which nothing compresses, in LONG datagrams."""
    pixels = np.random.RandomState(1).randint(0, 1 << 16, LARGE).astype(np.uint16)
    data = encode(pixels, True, 1 << 20).data
    threshold = GROUP // 2
    plan = Plan(LONG, [Layer(threshold, -(-len(data) // (threshold * LONG // GROUP)))])
    return Image(records_of(data, plan, LARGE, b'mono16'), data, (*LARGE, 1, 2))


def records_of(data: bytes, plan: Plan, shape: Any, encoding: bytes) -> Any:
    """The segments of an image."""
    layers = plan.layers
    records = frame_of(plan.count, len(layers), sum(layer.size for layer in layers), encoding)
    records['header']['frame_id'], records['encoding'] = list(b'camera'), list(encoding)
    records['height'], records['width'] = shape[:2]
    records['depth_unit'] = 0.001 if encoding == b'32FC1' else 0
    records['index'], records['count'] = np.arange(plan.count), plan.count
    records['thresholds'] = [layer.threshold for layer in layers]
    records['sizes'] = [layer.size for layer in layers]
    records['errors'] = range(len(layers))
    records['data'] = protect(data, plan)
    return records


def images() -> List[Image]:
    """Good images of all kinds."""
    found = [image_of(shape, item, lossless, seed) for seed, (shape, item, lossless) in enumerate(
        (shape, item, lossless) for shape in SHAPES for item in ((1,) if len(shape) == 3 else (1, 2))
        for lossless in (False, True))]
    for session, (shape, item, lossless) in enumerate((
            ((48, 64), 1, False), ((48, 64), 2, True), ((48, 64, 3), 1, False), ((61, 83), 2, False))):
        found += pair_of(shape, item, lossless, 1000 + session)
    return found + [image_of((48, 64), 2, True, 77, with_classes=True)]


class Fuzzer:
    """Feeds batches of segments to an assembler.

    :param random: of all that is random
    """

    def __init__(self, random: Random) -> None:
        self._random, self._numpy = random, np.random.RandomState(random.randrange(1 << 30))
        self._images, self._large = images(), [image_of(LARGE, 2, False, 78), noise()]
        self._assembler, self._settings = operator_side('image')
        self._now, self._stamp = 100.0, 1
        self.inputs = self.shown = 0
        self.worst = 0.0
        """Longest processor time of a batch [s]."""

    def report(self) -> str:
        """What became of the segments."""
        return '%d images shown; refused: %s' % (self.shown, dict(self.dropped))

    @property
    def dropped(self) -> Counter[str]:
        """Refused segments, by reason."""
        return collections.Counter(self._assembler.dropped)

    def good(self) -> None:
        """Feed the good images, which compiles all loops.

        :raises AssertionError: one of them is not shown
        """
        for image in self._large + self._images:
            before, first = self.shown, self._now
            # the second time at the latest: sizes of a stream grow only after some time
            while self.shown == before:
                self._now, self._stamp = self._now + 1, self._stamp + 1
                records = image.records.copy()
                records['header']['stamp']['secs'] = self._stamp
                self._assembler.receive(records, np.ones(len(records), bool), self._now, LAYERS)
                self._take()
                assert self.shown > before or self._now == first + 1, records[:1]

    def batch(self) -> None:
        """Feed one batch of others."""
        random = self._random
        if random.random() < 0.1:
            self._decode()
        records = self._random_segments() if random.random() < 0.1 else self._mutated()
        self._now += random.choice((0.0, 0.001, 0.03, 0.3, 1.0))
        self._stamp += random.random() < 0.7
        if random.random() < 0.95:
            records['header']['stamp']['secs'], records['header']['stamp']['nsecs'] = self._stamp, 5
        begun = time.process_time()
        self._assembler.receive(records, self._numpy.random_sample(len(records)) < 0.95, self._now, LAYERS)
        self._take()
        self.worst = max(self.worst, time.process_time() - begun)
        self.inputs += len(records)

    def _decode(self) -> None:
        """Decode a stream with faults, as no assembler would cut it; it counts as a segment."""
        random = self._random
        image = random.choice(self._images)
        data = bytearray(image.data)
        for _ in range(random.choice((1, 2, 5, 50))):
            data[random.randrange(random.choice((8, len(data))))] = self._byte()
        begun = time.process_time()
        height, width, channels, item = image.shape
        reference = self._numpy.randint(0, 256 ** item, (height, width, channels)[:2 + (channels > 1)])
        found = read(bytes(data[:random.choice((len(data), random.randrange(len(data))))]), *image.shape,
                     reference.astype('u%d' % item) if random.random() < 0.5 else None)
        if found is not None:
            found.prefixes.all_pixels()
            found.prefixes.pixels(random.randrange(len(data) + 9))
        self.worst = max(self.worst, time.process_time() - begun)
        self.inputs += 1

    def _byte(self) -> int:
        return self._random.choice((0, 1, 127, 255, self._random.randrange(256)))

    def _take(self) -> None:
        finished = self._assembler.poll(self._now)
        while finished is not None:
            assembled = self._assembler.assemble(finished, self._settings, False, self._now)
            if assembled is not None:
                self._assembler.settle(finished, assembled, self._settings, self._now)
                self.shown += 1
            finished = self._assembler.poll(self._now)

    def _mutated(self) -> Any:
        """Some segments of an image, most of them with faults."""
        random = self._random
        image = random.choice(self._large if random.random() < RARELY else self._images)
        chosen = self._numpy.randint(0, len(image.records), random.randint(1, 2 * len(image.records)))
        records = image.records[np.unique(chosen) if random.random() < 0.5 else chosen]
        for _ in range(random.choice((0, 1, 1, 1, 2, 3))):
            self._spoil(records)
        return records

    def _spoil(self, records: Any) -> None:
        """Make faults in any bytes, in the tables or in the data."""
        random, fault = self._random, self._random.random()
        if fault < 0.4:
            rows = records.view(np.uint8).reshape(len(records), -1)
            for _ in range(random.choice((1, 1, 3, 20))):
                which: Any = slice(None) if random.random() < 0.5 else random.randrange(len(records))
                rows[which, random.randrange(rows.shape[1])] = self._byte()
        elif fault < 0.7:
            # the beginning of the data is the beginning of the stream: its head
            records['data'][:, :random.randint(1, 30)] ^= random.choice((1, 2, 64, 255))
        elif fault < 0.8:
            records['data'] = self._numpy.randint(0, 256, records['data'].shape)
        elif fault < 0.9:
            records[random.choice(FIELDS)] = random.choice(VALUES)
        else:
            records['thresholds'] = np.sort(self._numpy.randint(0, 14, records['thresholds'].shape[1]))

    def _random_segments(self) -> Any:
        """Segments whose tables have any length, with likely and unlikely values."""
        random = self._random
        layers, count = random.choice((0, 1, 2, 5, 14, 15, 255)), random.choice((1, 2, 12, 240, 480, 4080, 65535))
        sizes = sorted(random.choice((0, 1, 3, 100, 65535)) for _ in range(layers))
        total = sum(sizes) if 0 < sum(sizes) < 1300 else random.randrange(1300)
        encoding = random.choice((b'mono8', b'mono16', b'bgr8', b'?', b''))
        records = frame_of(random.randint(1, 30), layers, total, encoding)
        rows = records.view(np.uint8).reshape(len(records), -1)
        if random.random() < 0.3:
            rows[:] = self._numpy.randint(0, 256, rows.shape)
            return records
        records['height'], records['width'] = random.choice(((48, 64), (1, 1), (4096, 4096), (1 << 31, 3), (0, 5)))
        if records['encoding'].shape[1]:
            records['encoding'] = list(b'mono16'[:records['encoding'].shape[1]])
        records['count'], records['sizes'] = count, sizes
        records['index'] = self._numpy.randint(0, random.choice((1, count, 65536)), len(records))
        records['thresholds'] = np.sort(self._numpy.randint(0, 256, layers))
        records['data'] = self._numpy.randint(0, 256, records['data'].shape)
        return records


if __name__ == '__main__':
    count, seed = [int(argument) for argument in sys.argv[1:]] + [SEGMENTS, 1][len(sys.argv) - 1:]
    sys.exit(run(Fuzzer(Random(seed)), count, MAX_TIME))
