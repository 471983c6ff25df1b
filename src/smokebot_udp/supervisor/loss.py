# SPDX-License-Identifier: BSD-3-Clause
"""What the air loses, told from what a full queue drops: the air loses as much when less is sent."""
import math

LASTS = 200
"""Datagrams over which loss is averaged."""

FIRST = 50
"""So many at the beginning are sent slowly enough: what they lose the air loses."""

MARGIN = 0.05
"""So much more, and twice what chance makes of it, is no chance."""


class Loss:
    """Shares of datagrams, of late."""

    def __init__(self):
        self.all = 0.0
        """Lost, wherever."""
        self.air = 0.0
        """Lost though the queue was short."""
        self._seen = 0

    def note(self, evidence, quiet):
        """Take a report's counts.

        :param evidence: report.Evidence
        :param quiet: whether these datagrams were sent so slowly that no queue can have been full
        """
        if not evidence.expected:
            return
        loss = 1 - evidence.received / evidence.expected
        self._seen += evidence.expected
        weight = evidence.expected / min(max(self._seen, evidence.expected), LASTS)
        self.all += min(1.0, weight) * (loss - self.all)
        if quiet or self._seen <= FIRST:
            self.air += min(1.0, 2 * weight) * (loss - self.air)
        self.air = min(self.air, self.all)

    def settle(self):
        """What was lost so far has been answered: only what is lost from now on tells more."""
        self.all = self.air

    @property
    def excess(self):
        """Of the datagrams that the air would not have lost the share that is lost all the same; 0: by chance only."""
        chance = math.sqrt(self.all * (1 - self.all) / LASTS * 2)
        if self.all <= self.air + MARGIN + 2 * chance:
            return 0.0
        return (self.all - self.air) / (1 - self.air)
