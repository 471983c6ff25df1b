# SPDX-License-Identifier: BSD-3-Clause
"""Video by this package's own encoder and assembler, over an offline link."""
import collections
import random
from typing import Deque, List, Optional, Sequence, Tuple

import numpy as np

from smokebot_udp.arrays import Array, BoolArray
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.codec import ImportedCodec
from smokebot_udp.streams.held import Holding
from smokebot_udp.udpros.datagram import IP_UDP_HEADERS
from smokebot_udp.udpros.frame import Frame

from .offline_link import (
    Sender,
    assemble_all,
    datagram_count,
    image_message,
    image_of,
    operator_side,
    part_of,
    records_of,
)
from .video_clips import RATE
from .video_link import REPORT_DELAY, Way

OPERATOR = 'operator'

SEEN = -1.0, -0.4
"""Times before the clip at which the operator has seen images of this size: assemblers do not believe in large ones at
once [s]."""

FIRST_STAMP = 10.0
"""Time stamp of the beginning of the clip [s]."""


class PackageVideo(Way):
    """A stream of images of this package; what the operator holds is reported as the loss is.

    :param coding: the setting
    :param rate: on the wire [bit/s]; each image has the same share
    :param first: image of the clip
    :param way_back: how likely a report of what is held is lost, 0..1; 1: there are none, so nothing is predicted
    """

    def __init__(self, coding: str, rate: float, first: Array, way_back: float, seed: object = 0) -> None:
        self._coding, self._size, self._now = coding, int(rate / 8 / RATE), SEEN[0]
        self._assembler, self._settings = operator_side('image', integrate='never')
        for when in SEEN:
            frames = self._new_sender().frames(image_message(first, FIRST_STAMP + when))
            self._assemble(frames, np.ones(datagram_count(frames), bool), when)
        self._sender = self._new_sender()
        self._way_back, self._draw = way_back, random.Random('way back %s' % seed).random
        self._frames: List[Frame] = []
        self._reports: Deque[Tuple[float, Holding]] = collections.deque()

    def send(self, image: Array, number: int, air: Air) -> Sequence[int]:
        self._now = number / RATE
        while self._reports and self._reports[0][0] <= self._now:
            self._sender.held(OPERATOR, self._reports.popleft()[1])
        self._sender.expect(air)
        self._frames = self._sender.frames(image_message(image, FIRST_STAMP + self._now))
        return [size for frame in self._frames for size in [frame.datagram_size + IP_UDP_HEADERS] * len(frame)]

    def receive(self, arrived: BoolArray) -> Optional[Array]:
        shown = self._assemble(self._frames, arrived, self._now)
        holding = self._assembler.holding()
        if holding is not None and self._draw() >= self._way_back:
            self._reports.append((self._now + REPORT_DELAY, holding))
        return shown

    def _new_sender(self) -> Sender:
        sender = Sender('image', ImportedCodec(), lambda: self._now, coding=self._coding, max_bytes=self._size)
        sender.serve(OPERATOR)
        return sender

    def _assemble(self, frames: List[Frame], arrived: BoolArray, now: float) -> Optional[Array]:
        """What the operator shows of an image's frames; None: nothing."""
        if not frames:
            return None
        part = part_of(self._assembler, frames[0])
        assembled = assemble_all(self._assembler, self._settings, records_of(frames, arrived), now, part=part)
        return image_of(assembled[-1].message) if assembled else None
