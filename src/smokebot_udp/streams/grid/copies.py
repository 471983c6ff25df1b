# SPDX-License-Identifier: BSD-3-Clause
"""How often and when a datagram is sent again until it is known to have arrived, by the packet loss that is expected.

What changed is sent again before a report could name it, where the loss is high: so that it is seen soon. Everything
else is sent again after a round trip of reports, or so often in one that a copy is likely to arrive. What is still not
acknowledged after many copies goes to an operator who does not receive or does not report, or who lies: more and more
rarely, down to the slow refresh cycle.
"""
import math
from typing import NamedTuple

from ...copies import believed, copies

ROUND_TRIP = 0.3
"""After this time a report names what arrived: it waits for the next one, 0.1 s at most, and crosses the link [s]."""

URGENT_TIME, URGENT_RESIDUAL = 0.25, 0.01
"""Copies of what changed leave within this time [s], and are all lost with this probability."""

PATIENT_RESIDUAL, MIN_TRIES, MAX_TRIES = 1e-4, 8, 100
"""Copies are suspicious once all of them were lost with a lower probability than this, but not after fewer, and after
more in any case."""

SLOWER = 2 ** 0.25
"""From then on, each interval is longer than the one before by this factor."""

MAX_COPIES = 24
"""Number of copies of what changed, and of an overview, at most. Higher losses than 0.82 are not made up for."""


def sent_for(needed: int, loss: float, residual: float, most: int = MAX_COPIES) -> int:
    """How many datagrams are sent so that fewer than are needed arrive with a probability of `residual` at most."""
    lost = believed(loss)
    count = needed
    while count < most and sum(math.comb(count, arrived) * (1 - lost) ** arrived * lost ** (count - arrived)
                               for arrived in range(needed)) > residual:
        count += 1
    return count


class Pattern(NamedTuple):
    """When copies follow."""
    loss: float
    """Expected packet-loss ratio."""
    slow: float
    """Longest interval, and that of operators who do not report [s]."""

    def interval(self, tries: int, urgent: bool) -> float:
        """How long after the last copy the next one is due [s].

        :param tries: copies sent already, at least 1
        :param urgent: whether it is of a change
        """
        if urgent:
            count = copies(self.loss, URGENT_RESIDUAL, MAX_COPIES)
            if tries < count:
                return URGENT_TIME / count
        a_round = max(1, round(1 / (1 - believed(self.loss))))
        fast_tries = max(MIN_TRIES, copies(self.loss, PATIENT_RESIDUAL, MAX_TRIES))
        return min(self.slow, ROUND_TRIP / a_round * SLOWER ** min(max(0, tries - fast_tries), 200))
