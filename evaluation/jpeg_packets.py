# SPDX-License-Identifier: BSD-3-Clause
"""The alternative to interleaved segments: a JPEG in packets, with or without an erasure code."""
import functools
from typing import List, NamedTuple, Optional, Sequence

import cv2
import numpy as np

from smokebot_udp.arrays import UInt8Array
from smokebot_udp.link_lab.channel import LinkConditions
from smokebot_udp.udpros.datagram import HEADER
from smokebot_udp.udpros.endpoints import IP_UDP_HEADERS

from .losses import failing
from .quality import psnr

MTU = 1500
MESSAGE_OVERHEAD = 60
"""Size of a sensor_msgs/CompressedImage without its JPEG: stamp, texts, lengths [byte]."""

SCALES = 1, 2, 4
QUALITIES = 1, 3, 5, 8, 12, 16, 20, 25, 30, 40, 50, 60, 70, 75, 80, 85, 90, 93, 95, 97, 98, 99, 100
STALE_PSNR = 15.0
"""PSNR that for_loss assumes of the image that stays on the display where a new one is lost [dB]."""


class ErasureCode(NamedTuple):
    """An ideal code: any `data` of the packets restore what was sent. No real code needs fewer."""
    data: int
    packets: int
    size: float
    """Size of each packet, with its headers [byte]."""

    @property
    def room(self) -> int:
        """The room for the JPEG [byte]."""
        return int(self.data * (self.size - IP_UDP_HEADERS - HEADER.size)) - MESSAGE_OVERHEAD

    def success(self, conditions: LinkConditions) -> float:
        """The probability that enough packets arrive."""
        return 1 - failing(conditions, self.data, self.packets)


def codes(budget: int) -> List[ErasureCode]:
    """All codes that use a budget on the wire [byte], in as few packets as carry it; the last has no redundancy."""
    packets = -(-budget // MTU)
    return [ErasureCode(data, packets, budget / packets) for data in range(1, packets + 1)]


def with_redundancy(budget: int, share: float) -> ErasureCode:
    """The code with the least redundancy from this share of the data on; budget [byte]."""
    return [code for code in codes(budget) if code.packets >= (1 + share) * code.data][-1]


def for_loss(budget: int, conditions: LinkConditions, ladders: Sequence['JpegLadder']) -> ErasureCode:
    """The code with the highest expected PSNR, on average over some images, for a loss known beforehand.

    :param budget: on the wire [byte]
    """
    def expected(code: ErasureCode) -> float:
        found = [ladder.best(code.room) for ladder in ladders]
        new = float(np.mean([STALE_PSNR if step is None else step.psnr for step in found]))
        return STALE_PSNR + code.success(conditions) * (new - STALE_PSNR)
    return max(codes(budget), key=expected)


class JpegStep(NamedTuple):
    """A JPEG of an image."""
    size: int
    """[byte]"""
    psnr: float
    """[dB]"""
    scale: int
    quality: int


class JpegLadder:
    """The JPEGs of an image at SCALES and QUALITIES.

    :param image: (height, width) or (height, width, 3) uint8
    """

    def __init__(self, image: UInt8Array) -> None:
        self._image = image
        steps = []
        for scale in SCALES:
            for quality in QUALITIES:
                data = self._encoded(scale, quality)
                steps.append(JpegStep(len(data), psnr(image, self._decoded(data)), scale, quality))
        self._steps = sorted(steps, key=lambda step: step.psnr)
        self.decoded = functools.lru_cache(maxsize=None)(self._best_decoded)

    def best(self, room: int) -> Optional[JpegStep]:
        """The best step within a size [byte]; None: there is none."""
        return next((step for step in reversed(self._steps) if step.size <= room), None)

    def _best_decoded(self, room: int) -> Optional[UInt8Array]:
        """The best image within a size [byte]: of the same shape, uint8; None: there is none."""
        step = self.best(room)
        return None if step is None else self._decoded(self._encoded(step.scale, step.quality))

    def _encoded(self, scale: int, quality: int) -> UInt8Array:
        height, width = self._image.shape[:2]
        small = cv2.resize(self._image, (width // scale, height // scale), interpolation=cv2.INTER_AREA)
        data: UInt8Array = cv2.imencode(
            '.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1])[1]
        return data

    def _decoded(self, data: UInt8Array) -> UInt8Array:
        small = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        image: UInt8Array = cv2.resize(small, self._image.shape[1::-1], interpolation=cv2.INTER_CUBIC)
        return image
