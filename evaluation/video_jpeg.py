# SPDX-License-Identifier: BSD-3-Clause
"""Video as a JPEG of each image, with the ideal erasure code that is best for a loss known beforehand."""
import math
from typing import Dict, List, Optional, Sequence

import numpy as np

from smokebot_udp.arrays import Array, BoolArray
from smokebot_udp.link_lab.channel import LinkConditions
from smokebot_udp.streams.air import Air

from .jpeg_packets import ErasureCode, JpegLadder, codes
from .video_clips import RATE, Clip
from .video_link import CHOICE_IMAGES, CHOICE_SEED, Way, constant, watch

CANDIDATES = 12
"""Codes that are tried, about."""


class Jpegs:
    """The JPEGs of a clip; images that come again are encoded once."""

    def __init__(self, clip: Clip) -> None:
        self._ladders: Dict[int, JpegLadder] = {}
        for image in clip:
            if id(image) not in self._ladders:
                self._ladders[id(image)] = JpegLadder(image)
        self._clip = clip

    def ladder(self, number: int) -> JpegLadder:
        """The ladder of the image with this number."""
        return self._ladders[id(self._clip[number])]

    def code(self, rate: float, conditions: LinkConditions) -> ErasureCode:
        """The best code on such a link, found by simulation with another seed; rate: on the wire [bit/s]."""
        clip = self._clip[:CHOICE_IMAGES]

        def quality(code: ErasureCode) -> float:
            return watch(clip, JpegVideo(self, code), constant(conditions), CHOICE_SEED, rate).mean
        found = codes(int(rate / 8 / RATE))
        return max(found[::math.ceil(len(found) / CANDIDATES)] + found[-1:], key=quality)


class JpegVideo(Way):
    """The best JPEG of each image that leaves room for the code."""

    def __init__(self, jpegs: Jpegs, code: ErasureCode) -> None:
        self._jpegs, self._code = jpegs, code
        self._number = 0

    def send(self, image: Array, number: int, air: Air) -> Sequence[int]:
        self._number = number
        sizes: List[int] = [int(self._code.size)] * self._code.packets
        return sizes

    def receive(self, arrived: BoolArray) -> Optional[Array]:
        if np.count_nonzero(arrived) < self._code.data:
            return None
        return self._jpegs.ladder(self._number).decoded(self._code.room)
