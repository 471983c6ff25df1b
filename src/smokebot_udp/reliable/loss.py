# SPDX-License-Identifier: BSD-3-Clause
"""Which part of a node's segments does not reach a peer, by what the peer counts; and how many copies that takes."""
import math
from typing import NamedTuple, Optional, Tuple

from ..copies import copies

EXPECTED_LOSS = 0.2
"""Loss that is assumed before anything is measured, 0..1."""

EXPECTED_WEIGHT = 5.0
"""EXPECTED_LOSS weighs as much as this number of segments."""

MEMORY = 50.0
"""Older segments count less and less: half of what counts are the last 35 [segments]."""


class Copies(NamedTuple):
    """How often something is sent before a timeout."""
    failure: float
    """Probability that no copy arrives, 0..1. It decides how many copies are sent."""
    most: int
    """Number of copies, at most."""


EXPEDITED = Copies(0.02, 6)
"""What somebody waits for."""

ORDINARY = Copies(0.3, 3)
"""At a high loss two copies cost no more than a copy after each timeout: acknowledgements are lost, too."""


class LossMeter:
    """The loss of what is sent to one peer."""

    def __init__(self) -> None:
        self._sent, self._arrived = EXPECTED_WEIGHT, EXPECTED_WEIGHT * (1 - EXPECTED_LOSS)
        self._last: Optional[Tuple[int, int]] = None

    def add(self, seq: int, arrived: int) -> None:
        """Take what an acknowledgement says. One that was overtaken by a newer one has no effect.

        :param seq: of the segment that caused it
        :param arrived: segments that had arrived until then
        """
        if self._last is None:
            self._last = seq, arrived
        sent, came = seq - self._last[0], arrived - self._last[1]
        if sent <= 0 or came < 0:
            return
        self._last = seq, arrived
        kept = math.exp(-sent / MEMORY)
        self._sent = self._sent * kept + sent
        self._arrived = self._arrived * kept + min(came, sent)

    def renew(self) -> None:
        """The peer counts anew."""
        self._last = None

    @property
    def loss(self) -> float:
        """0..1"""
        return max(0.0, 1 - self._arrived / self._sent)

    def copies(self, wanted: Copies) -> int:
        """How often something is sent before a timeout, at least once."""
        return copies(self.loss, wanted.failure, wanted.most)
