# SPDX-License-Identifier: BSD-3-Clause
"""What congestion control has to reach, in simulation and over the emulated link."""
from typing import Any, List, Mapping, NamedTuple, Sequence, Tuple


class Goal(NamedTuple):
    """A bound of one quantity."""
    quantity: str
    bound: float
    at_least: bool = False

    def met(self, value: float) -> bool:
        """Whether a value keeps it."""
        return value >= self.bound if self.at_least else value <= self.bound

    def __str__(self) -> str:
        return '%s %g' % ('≥' if self.at_least else '≤', self.bound)


def used(at_least: float) -> Goal:
    """Goal: at least this share of the link is used [%]."""
    return Goal('used [%]', at_least, True)


def lost(at_most: float) -> Goal:
    """Goal: a full queue or a policer drops at most this share of what was sent [%]."""
    return Goal('own loss [%]', at_most)


def queue(at_most: float) -> Goal:
    """Goal: the 95th percentile of the time in the queue is at most this [ms]."""
    return Goal('queue p95 [ms]', at_most)


def share(at_least: float, at_most: float) -> Tuple[Goal, Goal]:
    """Goals: our share of the throughput of all flows is between these limits [%]."""
    return Goal('share [%]', at_least, True), Goal('share [%]', at_most)


def unmet(goals: Sequence[Goal], values: Mapping[str, Any]) -> List[Goal]:
    """The goals that {quantity: value} misses; a quantity without a value misses its goals."""
    return [goal for goal in goals if values[goal.quantity] is None or not goal.met(values[goal.quantity])]
