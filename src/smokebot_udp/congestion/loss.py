# SPDX-License-Identifier: BSD-3-Clause
"""Separates wireless loss from congestion loss: the air loses as much when less is sent, a full queue does not."""
import math

from .feedback import Feedback

AVERAGING_WINDOW = 200
"""Number of datagrams over which recent loss is averaged."""

EVIDENCE_WINDOW = 600
"""Number of datagrams over which loss is averaged to separate the air's loss from congestion loss."""

PRIOR_COUNT, SUSPICIOUS_COUNT = 20, 200
"""The prior that the air loses nothing weighs as much as this many datagrams; before a check as this many."""

EXCESS_MARGIN = 0.05
"""Loss beyond the air's is congestion only above this, plus twice the standard deviation."""

DISPERSION_REPORTS = 20
"""Dispersion is averaged over this many reports."""

MAX_DISPERSION = 20.0
"""Dispersion that one report shows, at most."""

MAX_AIR_LOSS = 0.95
"""Above this the link is taken for gone rather than lossy."""


class Loss:
    """Loss ratios of one link, averaged."""

    def __init__(self) -> None:
        self.unanswered = 0.0
        """Loss ratio since `answered` was called last, whatever the cause."""
        self.recent = 0.0
        """Recent loss ratio, whatever the cause."""
        self.lost = 0
        """Datagrams lost so far."""
        self.dispersion = 1.0
        """Variance of the number lost, compared with that of independent losses, at least 1: of bursts it is more."""
        self._count = self._evidence = self._uncongested = self._uncongested_lost = 0.0
        self._spread = 1.0      # variance of `unanswered`, in terms of that of a single datagram

    def update(self, feedback: Feedback, uncongested: bool) -> None:
        """Take the counts of a report.

        :param uncongested: whether its datagrams were sent so slowly that no queue can have been full
        """
        count, lost = feedback.expected, feedback.lost
        if not count:
            return
        self.lost += lost
        self._count = min(self._count + count, AVERAGING_WINDOW)
        self._measure_dispersion(count, lost)
        self._evidence = min(self._evidence + count, EVIDENCE_WINDOW)
        weight = min(1.0, count / self._evidence)
        self.unanswered += weight * (lost / count - self.unanswered)
        self._spread = (1 - weight) ** 2 * self._spread + weight ** 2 / count
        self.recent += min(1.0, count / self._count) * (lost / count - self.recent)
        if uncongested:
            keep = max(0.0, 1 - count / EVIDENCE_WINDOW)
            self._uncongested = keep * self._uncongested + count
            self._uncongested_lost = keep * self._uncongested_lost + lost

    def _measure_dispersion(self, count: int, lost: int) -> None:
        variance = count * self.recent * (1 - self.recent)
        found = 1.0 if variance < 0.5 else min(MAX_DISPERSION, (lost - count * self.recent) ** 2 / variance)
        self.dispersion = max(1.0, self.dispersion + (found - self.dispersion) / DISPERSION_REPORTS)

    def set_air(self, count: int, lost: int) -> None:
        """It is known what the air loses: of `count` datagrams `lost`."""
        self._uncongested, self._uncongested_lost = float(count), float(lost)

    def beyond_air(self, lost: float) -> float:
        """Ratio of the datagrams let through by the air that are lost all the same, where the ratio `lost` of all is
        lost."""
        return max(0.0, (lost - self.air) / (1 - self.air))

    def exceeds_air(self, count: int, lost: int) -> bool:
        """Whether so many lost of `count` are more than what the air loses, and than chance."""
        deviation = math.sqrt(self.dispersion * count * self.air * (1 - self.air))
        return lost > self.air * count + 2 * deviation + max(2.0, 0.01 * count)

    def usual(self, count: int) -> float:
        """How many of `count` datagrams the air is expected to lose, plus a standard deviation."""
        mean = self.air * count
        return mean + math.sqrt(mean)

    def answered(self) -> None:
        """The rate was lowered for the excess so far: only new loss counts from now on."""
        self.unanswered = min(self.unanswered, self.air)

    @property
    def air(self) -> float:
        """Loss ratio while the queue was short."""
        return min(MAX_AIR_LOSS, self._uncongested_lost / max(self._uncongested, 1.0))

    @property
    def excess(self) -> float:
        """Ratio of the datagrams let through by the air that are lost all the same; 0: within chance."""
        return self.beyond_air(self.unanswered) if self._significant(PRIOR_COUNT) else 0.0

    @property
    def suspicious(self) -> bool:
        """Whether a check is due, which does no harm where the air is not known: the prior weighs more than for
        `excess`, but in bursts more is lost by chance."""
        return self.excess > 0 or self._significant(SUSPICIOUS_COUNT, self.dispersion)

    def _significant(self, prior: float, dispersion: float = 1.0) -> bool:
        deviation = math.sqrt(dispersion * self.unanswered * (1 - self.unanswered)
                              * (self._spread + 1 / (self._uncongested + prior)))
        return self.unanswered - self.air > EXCESS_MARGIN + 2 * deviation
