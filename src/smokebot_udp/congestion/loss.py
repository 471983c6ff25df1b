# SPDX-License-Identifier: BSD-3-Clause
"""What the air loses, told from what a full queue drops: the air loses as much when less is sent."""
import math

LASTS = 200
"""Datagrams over which loss is averaged."""

SUPPOSED = 20
"""The air is supposed to lose nothing, as if so many datagrams had shown it."""

MARGIN = 0.05
"""So much more, and what chance makes of it twice, is no chance."""

MOST = 0.95
"""The air is not believed to lose more: where more is lost the link is gone."""


class Loss:
    """Shares of datagrams, of late."""

    def __init__(self):
        self.all = 0.0
        """Lost, wherever, since that was answered."""
        self.told = 0.0
        """Lost, wherever, of late."""
        self._count, self._quiet, self._quiet_lost = 0.0, 0.0, 0.0

    def note(self, evidence, quiet):
        """Take a report's counts.

        :param evidence: report.Evidence
        :param quiet: whether these datagrams were sent so slowly that no queue can have been full
        """
        count, lost = evidence.expected, evidence.expected - evidence.received
        if not count:
            return
        self._count = min(self._count + count, LASTS)
        weight = min(1.0, count / self._count)
        self.all += weight * (lost / count - self.all)
        self.told += weight * (lost / count - self.told)
        if quiet:
            keeps = max(0.0, 1 - count / LASTS)
            self._quiet, self._quiet_lost = keeps * self._quiet + count, keeps * self._quiet_lost + lost

    def settle(self):
        """What was lost so far has been answered: only what is lost from now on tells more."""
        self.all = min(self.all, self.air)

    @property
    def air(self):
        """Lost though the queue was short."""
        return min(MOST, self._quiet_lost / max(self._quiet, 1.0))

    @property
    def excess(self):
        """Of the datagrams that the air would not have lost the share that is lost all the same; 0: by chance only."""
        chance = math.sqrt(self.all * (1 - self.all) * (2 / LASTS + 1 / (self._quiet + SUPPOSED)))
        more = self.all - self.air
        return more / (1 - self.air) if more > MARGIN + 2 * chance else 0.0
