# SPDX-License-Identifier: BSD-3-Clause
"""What one would send instead of segments: a JPEG in packets, with a code that restores lost ones, or without."""
import functools
from typing import NamedTuple

import cv2
import numpy as np
from scipy import stats
from skimage.metrics import peak_signal_noise_ratio

from smokebot_udp.udpros.datagram import HEADER
from smokebot_udp.udpros.endpoints import IP_UDP_HEADERS

MTU = 1500
HEAD = 60
"""Bytes of a sensor_msgs/CompressedImage beside its JPEG: stamp, names, lengths."""

SCALES = 1, 2, 4
QUALITIES = 1, 3, 5, 8, 12, 16, 20, 25, 30, 40, 50, 60, 70, 75, 80, 85, 90, 93, 95, 97, 98, 99, 100
NOTHING = 15.0
"""What an old picture is worth when a code is chosen [dB]."""


class Code(NamedTuple):
    """Any `data` of so many packets restore what was sent: no code does with fewer, none is computed faster."""
    data: int
    packets: int
    size: float
    """Of each packet, its headers included [byte]."""

    @property
    def room(self):
        """Bytes for the JPEG."""
        return int(self.data * (self.size - IP_UDP_HEADERS - HEADER.size)) - HEAD

    def restored(self, loss):
        """How likely enough packets come, where they are lost independently."""
        return stats.binom.sf(self.data - 1, self.packets, 1 - loss)


def codes(budget):
    """All codes that use a budget of so many bytes on the wire, in as few packets as carry it; the last adds none."""
    packets = -(-budget // MTU)
    return [Code(data, packets, budget / packets) for data in range(1, packets + 1)]


def with_overhead(budget, share):
    """The code that adds at least this share to what it protects."""
    return [code for code in codes(budget) if code.packets >= (1 + share) * code.data][-1]


def for_loss(budget, loss, ladders):
    """The code that promises most, on average over some pictures, where this loss is known beforehand."""
    def promise(code):
        found = [ladder.best(code.room) for ladder in ladders]
        worth = np.mean([NOTHING if step is None else step.psnr for step in found])
        return NOTHING + code.restored(loss) * (worth - NOTHING)
    return max(codes(budget), key=promise)


class Step(NamedTuple):
    size: int
    """[byte]"""
    psnr: float
    """[dB]"""
    scale: int
    quality: int


class Ladder:
    """The JPEGs of a picture: of its own size, half and a quarter of it, of many qualities.

    :param picture: (height, width) uint8
    """

    def __init__(self, picture):
        self._picture = picture
        steps = []
        for scale in SCALES:
            for quality in QUALITIES:
                data = self._encoded(scale, quality)
                steps.append(Step(len(data), peak_signal_noise_ratio(picture, self._decoded(data)), scale, quality))
        self._steps = sorted(steps, key=lambda step: step.psnr)
        self.decoded = functools.lru_cache(maxsize=None)(self._best_decoded)

    def best(self, room):
        """The best Step within so many bytes, or None."""
        return next((step for step in reversed(self._steps) if step.size <= room), None)

    def _best_decoded(self, room):
        """What one sees of the best within so many bytes: (height, width) uint8, or None."""
        step = self.best(room)
        return None if step is None else self._decoded(self._encoded(step.scale, step.quality))

    def _encoded(self, scale, quality):
        height, width = self._picture.shape
        small = cv2.resize(self._picture, (width // scale, height // scale), interpolation=cv2.INTER_AREA)
        return cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1])[1]

    def _decoded(self, data):
        small = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        return cv2.resize(small, self._picture.shape[::-1], interpolation=cv2.INTER_CUBIC)
