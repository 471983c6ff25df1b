#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hostile slices of video, through the process that decodes them.

    ./smokebot exec python3 test/fuzz/fuzz_video.py [SLICES [SEED]]

Slices of good images are mutated, dropped, repeated, mixed with those of other images and sessions and with random
ones; so are parameter sets and what is announced. The process may die or hang, but each time only for a moment: any
exception is a fault, and so is an image that takes this one more than MAX_TIME of processor time, or a good image that
is not shown afterwards. Prints what was refused, and by how much the memory of this process grew.
"""
import logging
import pathlib
import sys
import time
from random import Random
from typing import Counter, List, Sequence

import numpy as np

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2]), str(pathlib.Path(__file__).resolve().parent)]
from fuzzing import run  # noqa: E402

from smokebot_udp.codecs.video import nal  # noqa: E402
from smokebot_udp.codecs.video.decoder_request import Request  # noqa: E402
from smokebot_udp.codecs.video.encoder import LEAST_ROOM, VideoEncoder  # noqa: E402
from smokebot_udp.nodes.video_decoder import VideoDecoder  # noqa: E402

MAX_TIME = 0.2
"""Maximum processor time of an image in this process [s]."""

SLICES = 1000000
SHAPES = ((48, 64), (97, 131), (240, 320), (48, 64, 3))
IMAGES = 24
"""Number of images of each good stream."""

BEGINNING = 20
"""Half of the faults are made among this many of the first bytes: the head of a slice, or of the parameter sets."""

GOOD_TIME = 60.0
"""Within this time a good image is shown, whatever happened before [s]."""


def stream(shape: Sequence[int], session: int) -> List[Request]:
    """A good stream: noise that moves over a gradient."""
    random = np.random.RandomState(session)
    encoder = VideoEncoder(shape[0], shape[1], 'bgr8' if len(shape) == 3 else 'mono8', 4000, LEAST_ROOM, 10)
    scene = np.add.outer(np.arange(shape[0]), np.arange(2 * shape[1])) % 200
    scene = scene.reshape(*scene.shape, *(1,) * (len(shape) - 2)) + random.randint(0, 50, (*scene.shape, *shape[2:]))
    found = []
    for number in range(IMAGES):
        coded = encoder.encode(scene[:, number:number + shape[1]].astype(np.uint8), 4000)
        found.append(Request(session, shape[0], shape[1], len(shape) == 3, coded.parameter_sets, coded.slices))
    return found


class Fuzzer:
    """Feeds images to the decoder of one stream.

    :param random: of all that is random
    """

    def __init__(self, random: Random) -> None:
        self._random = random
        self._streams = [stream(shape, session) for session, shape in enumerate(SHAPES, 1)]
        self._decoder = VideoDecoder('fuzz')
        self.inputs = self.shown = 0
        self.worst = 0.0
        """Longest processor time of an image, of this process [s]."""

    @property
    def dropped(self) -> Counter[str]:
        """Refused images, by reason."""
        return self._decoder.dropped

    def report(self) -> str:
        """What was shown and refused."""
        return '%d images shown; refused: %s' % (self.shown, dict(self.dropped))

    def good(self) -> None:
        """Decode good streams.

        :raises AssertionError: one of them is not shown
        """
        for images in self._streams:
            until = time.monotonic() + GOOD_TIME
            while self._decoder.decode(images[0]) is None:
                assert time.monotonic() < until, self.report()
            for image in images[1:]:
                assert self._decoder.decode(image) is not None, self.report()

    def batch(self) -> None:
        """Decode one other image."""
        image = self._mutated()
        begun = time.thread_time()
        self.shown += self._decoder.decode(image) is not None
        self.worst = max(self.worst, time.thread_time() - begun)
        self.inputs += len(image.slices)

    def _mutated(self) -> Request:
        random = self._random
        images = random.choice(self._streams)
        image = random.choice(images)
        slices = [unit for unit in image.slices if random.random() < 0.9] or list(image.slices)
        for _ in range(random.choice((0, 1, 1, 2, 5))):
            fault, at = random.random(), random.randrange(len(slices))
            if fault < 0.7:
                slices[at] = self._spoiled(slices[at])
            elif fault < 0.8:
                slices.insert(at, random.choice(random.choice(random.choice(self._streams)).slices))
            elif fault < 0.9:
                slices.insert(at, bytes([random.randrange(256)]) + self._bytes(random.choice((0, 1, 9, 99, 999))))
            else:
                slices[at] = self._unit(random.choice((0, 1, 2, 5, 6, 7, 8, 9, 14, 20, 31)), slices[at])
        return self._announced(image._replace(slices=slices))

    def _announced(self, image: Request) -> Request:
        """With faults in what is announced."""
        random = self._random
        if random.random() < 0.1:
            image = image._replace(parameter_sets=random.choice((
                b'', self._spoiled(image.parameter_sets), random.choice(self._streams)[0].parameter_sets,
                nal.byte_stream([self._bytes(9), self._bytes(9)]))))
        if random.random() < 0.02:
            image = image._replace(session=random.choice((0, 9, 2 ** 32 - 1, 2 ** 32)))
        if random.random() < 0.02:
            image = image._replace(height=random.choice((0, 1, 47, 4096)), width=random.choice((0, 64, 1024, 1 << 31)))
        if random.random() < 0.02:
            image = image._replace(colour=not image.colour)
        return image

    def _spoiled(self, data: bytes) -> bytes:
        """Some bits or bytes changed, cut off, or appended."""
        random, spoiled = self._random, bytearray(data)
        for _ in range(random.choice((1, 1, 2, 8, 40))):
            at = random.randrange(min(len(data), BEGINNING) if random.random() < 0.5 else len(data))
            spoiled[at] = random.choice((0, 255, random.randrange(256), spoiled[at] ^ 1 << random.randrange(8)))
        if random.random() < 0.1:
            del spoiled[random.randrange(1, len(spoiled)) if len(spoiled) > 1 else 1:]
        return bytes(spoiled)

    def _bytes(self, count: int) -> bytes:
        return bytes(self._random.getrandbits(8) for _ in range(count))

    @staticmethod
    def _unit(kind: int, data: bytes) -> bytes:
        """As a NAL unit of another type."""
        return bytes([data[0] & 0xe0 | kind]) + data[1:]


if __name__ == '__main__':
    logging.disable(logging.CRITICAL)       # each process that dies would be reported
    count, seed = [int(argument) for argument in sys.argv[1:]] + [SLICES, 1][len(sys.argv) - 1:]
    sys.exit(run(Fuzzer(Random(seed)), count, MAX_TIME))
