# SPDX-License-Identifier: BSD-3-Clause
"""A clip over an offline link: one way of sending, seeded losses, reports that come late, and what the screen shows."""
import collections
import math
import time
from typing import Callable, Deque, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from smokebot_udp.arrays import Array, BoolArray, FloatArray
from smokebot_udp.link_lab.channel import Channel, LinkConditions
from smokebot_udp.streams.air import Air, LossBeliefs

from .jpeg_packets import MTU
from .losses import delivered
from .quality import psnr
from .video_clips import RATE, Clip

REPORT_DELAY = 0.15
"""From when an image is sent to when the report that counts its datagrams is known to the robot [s]."""

REPORTED = 6.0
"""The stream was reported on for so long before the clip begins [s]."""

GREY = 128
"""What the screen shows before the first image; of 16 bits: the first image's mean."""

SETTLED = 10
"""Images at the beginning that do not count: all ways start with an empty screen."""

CHOICE_IMAGES, CHOICE_SEED = 40, 'choice'
"""Images of a clip and seed of the losses by which a peer is chosen for a link that is known."""

VISIBLE = 30.0
"""An image is good enough to drive by from this PSNR on [dB]."""

Conditions = Callable[[float], LinkConditions]
"""f(time since the clip began [s])"""


class Way:
    """A way of sending video, both sides of it."""
    beforehand: float = 0.0
    """CPU time per image for what was encoded before [s]."""

    def send(self, image: Array, number: int, air: Air) -> Sequence[int]:
        """Send the next image.

        :param number: of the image, from 0 on
        :param air: what the reports say about the link
        :return: the sizes of its datagrams as IP packets, in sending order [byte]
        """
        raise NotImplementedError

    def receive(self, arrived: BoolArray) -> Optional[Array]:
        """Take those datagrams of the image that arrived.

        :param arrived: (n,) bool
        :return: the newest image that can be shown now; None: nothing new
        """
        raise NotImplementedError


class Watched(NamedTuple):
    """What was seen of a clip; n images."""
    psnr: FloatArray
    """(n,) of the screen against what the camera saw at the same instant [dB]"""
    new: BoolArray
    """(n,) whether something new was shown"""
    sizes: FloatArray
    """(n,) of the images on the wire [byte]"""
    encoding: float
    """CPU time per image [s]."""
    decoding: float
    screens: List[Array]
    """What was shown at each time."""

    @property
    def mean(self) -> float:
        """PSNR [dB]."""
        return float(self.psnr[SETTLED:].mean())

    @property
    def visible(self) -> float:
        """The share of time in which the screen was VISIBLE, 0..1."""
        return float((self.psnr[SETTLED:] >= VISIBLE).mean())

    @property
    def freeze(self) -> float:
        """The longest time without anything new [s]."""
        longest = run = 0
        for new in self.new[SETTLED:]:
            run = 0 if new else run + 1
            longest = max(longest, run)
        return longest / RATE

    @property
    def rate(self) -> float:
        """On the wire, of the images that count [bit/s]."""
        return float(self.sizes[SETTLED:].mean()) * 8 * RATE


def constant(conditions: LinkConditions) -> Conditions:
    """A link that does not change."""
    return lambda now: conditions


class Reports:
    """What the robot knows of the link: counts of what arrived, REPORT_DELAY late. Times [s]."""

    def __init__(self) -> None:
        self._beliefs = LossBeliefs()
        self._coming: Deque[Tuple[float, int, int]] = collections.deque()

    def count(self, arrived: BoolArray, now: float) -> None:
        """Which of the packets arrived that were sent now."""
        self._coming.append((now + REPORT_DELAY, len(arrived), int(np.count_nonzero(arrived))))

    def air(self, now: float) -> Air:
        """What the reports that have come say."""
        while self._coming and self._coming[0][0] <= now:
            when, sent, received = self._coming.popleft()
            self._beliefs.add(sent, received, when)
        return self._beliefs.air(now)


def watch(clip: Clip, way: Way, conditions: Conditions, seed: object, rate: float) -> Watched:
    """Send a clip of more than SETTLED images over a link, and watch the screen.

    PSNR of 16 bits is of the range of the clip.

    :param rate: of the stream before the clip began, when only reports came [bit/s]
    """
    value_range = None if clip[0].itemsize == 1 else float(np.ptp([(image.min(), image.max()) for image in clip]))
    channel, reports = Channel(conditions(0.0), seed=seed), Reports()
    for number in range(int(-REPORTED * RATE), 0):
        reports.count(delivered(channel, math.ceil(rate / 8 / RATE / MTU)), number / RATE)
    screen = np.full_like(clip[0], GREY if clip[0].itemsize == 1 else clip[0].mean())
    found: List[Tuple[float, bool, int]] = []
    screens: List[Array] = []
    encoding = decoding = 0.0
    for number, image in enumerate(clip):
        now = number / RATE
        channel.conditions = conditions(now)
        began = time.process_time()
        sizes = way.send(image, number, reports.air(now))
        encoded = time.process_time()
        arrived = delivered(channel, len(sizes))
        reports.count(arrived, now)
        shown = way.receive(arrived)
        if number >= SETTLED:       # by then all is compiled
            decoding += time.process_time() - encoded
            encoding += encoded - began
        screen = screen if shown is None else shown
        screens.append(screen)
        found.append((psnr(image, screen, value_range), shown is not None, int(sum(sizes))))
    values, new, sent_bytes = zip(*found)
    counted = len(clip) - SETTLED
    return Watched(np.array(values), np.array(new), np.array(sent_bytes, float), way.beforehand + encoding / counted,
                   decoding / counted, screens)
