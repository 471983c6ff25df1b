# SPDX-License-Identifier: BSD-3-Clause
"""Which datagrams or subimages arrive."""
from typing import Iterator

import numpy as np

from smokebot_udp.arrays import BoolArray
from smokebot_udp.codecs.layered.survival import arrivals
from smokebot_udp.codecs.wire.interleave import Interleave
from smokebot_udp.link_lab.channel import Channel, LinkConditions


def patterns(cut: Interleave, loss: float, count: int) -> Iterator[BoolArray]:
    """Random sets of the subimages that arrive, at least one in each: (n,) bool. They are always the same."""
    random = np.random.RandomState(1)
    while count:
        have = random.random_sample(len(cut)) >= loss
        if have.any():
            yield have
            count -= 1


def delivered(channel: Channel, count: int) -> BoolArray:
    """Which of some datagrams a channel delivers, sent one after the other: (count,) bool."""
    return np.array([bool(channel.fate(0.0, 1)) for _ in range(count)])


def failing(conditions: LinkConditions, needed: int, packets: int) -> float:
    """How likely fewer than `needed` of some packets arrive, sent one after the other: 0..1."""
    if conditions.loss in (0, 1):
        return float(conditions.loss)
    recovery = 1 - conditions.chain[1]
    return float(arrivals(packets, np.array([conditions.loss]), np.array([recovery]))[0, :needed].sum())
