# SPDX-License-Identifier: BSD-3-Clause
"""Separates wireless loss from congestion loss: the air loses as much when less is sent, a full queue does not."""
import math

from .feedback import Feedback

AVERAGING_WINDOW = 200
"""Loss is averaged over this many datagrams."""

PRIOR_COUNT = 20
"""The prior that the air loses nothing weighs as much as this many datagrams."""

EXCESS_MARGIN = 0.05
"""Loss beyond the air's is congestion only above this, plus twice the standard deviation."""

MAX_AIR_LOSS = 0.95
"""Above this the link is taken for gone rather than lossy."""


class Loss:
    """Loss ratios of one link, averaged."""

    def __init__(self) -> None:
        self.unanswered = 0.0
        """Of all loss since `answered` was called last."""
        self.recent = 0.0
        """Of all loss."""
        self._count = self._uncongested = self._uncongested_lost = 0.0

    def update(self, feedback: Feedback, uncongested: bool) -> None:
        """Take the counts of a report.

        :param uncongested: whether its datagrams were sent so slowly that no queue can have been full
        """
        count, lost = feedback.expected, feedback.expected - feedback.received
        if not count:
            return
        self._count = min(self._count + count, AVERAGING_WINDOW)
        gain = min(1.0, count / self._count)
        self.unanswered += gain * (lost / count - self.unanswered)
        self.recent += gain * (lost / count - self.recent)
        if uncongested:
            keep = max(0.0, 1 - count / AVERAGING_WINDOW)
            self._uncongested = keep * self._uncongested + count
            self._uncongested_lost = keep * self._uncongested_lost + lost

    def answered(self) -> None:
        """The rate was lowered for the excess so far: only new loss counts from now on."""
        self.unanswered = min(self.unanswered, self.air)

    @property
    def air(self) -> float:
        """Loss ratio while the queue was short."""
        return min(MAX_AIR_LOSS, self._uncongested_lost / max(self._uncongested, 1.0))

    @property
    def excess(self) -> float:
        """Of the datagrams that the air let through, the ratio lost all the same; 0: within chance."""
        deviation = math.sqrt(self.unanswered * (1 - self.unanswered)
                              * (2 / AVERAGING_WINDOW + 1 / (self._uncongested + PRIOR_COUNT)))
        beyond = self.unanswered - self.air
        return beyond / (1 - self.air) if beyond > EXCESS_MARGIN + 2 * deviation else 0.0
