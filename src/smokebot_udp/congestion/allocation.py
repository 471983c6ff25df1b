# SPDX-License-Identifier: BSD-3-Clause
"""Who gets how much of the link, and what each stream makes of it.

What is protected is served first. Then each stream gets its floor, and what is left goes by weights; what a stream
cannot use flows to the others. A share is turned into the best level (levels.py) that it pays for; where levels leave
something over, it lifts others. Down goes it at once, for the link has no more; up only where the link would pay for
more than the next level, and has for a while, or for much more.
"""
import math
from dataclasses import dataclass
from typing import Any, Dict, List, NamedTuple, Optional

from .operating_points import Level

MARGIN = 1.05
"""A level above the present one is taken where the share is so much more than it costs,"""

HOLD = 1.0
"""and has been for so long [s],"""

LEAP = 1.5
"""or at once where the budget is so much more than all that is granted."""

BUDGET = 0.95
"""Of the capacity so much is to be divided: what is left is for what came unforeseen."""

DATAGRAM_TAKES, LEAST_DATAGRAM = 0.012, 400
"""A datagram is to take so long of the link at most [s], but is no shorter than this [byte]."""

PROTECTED_PART, THINNEST = 0.4, 0.25
"""Where protected streams take more of the link than the first, they are sent more rarely, down to the second of their
rates: a link that odometry fills shows nothing."""

THINNED_FOR = 3.0
"""So long at least: what they take is measured over 2 s [s]."""


@dataclass
class Demand:
    """What a stream would have."""
    levels: List[Level]
    """The cheapest first."""
    weight: float = 1.0
    floor: float = 0.0
    """[byte/s]"""


class Grant(NamedTuple):
    """What a stream gets."""
    share: float
    """[byte/s]"""
    level: Optional[int]
    """Which of its levels; None: not even the least can be paid for."""
    settings: Dict[str, Any]
    """The level's; empty without one."""
    cost: float
    """What the level takes of the link [byte/s]."""


def datagram_size(rate, most):
    """How long datagrams had better be: on a slow link short ones, for who waits behind them [byte].

    :param rate: of the link [byte/s]
    :param most: where the link is fast [byte]
    """
    return int(min(most, max(LEAST_DATAGRAM, rate * DATAGRAM_TAKES)))


class DatagramSize:
    """Halves datagrams, again and again, where the link is slow; they are long again where it is surely fast.

    :param most: [byte]
    """

    def __init__(self, most):
        self._most, self._halved = most, 0

    def follow(self, rate):
        """How long datagrams are to be now [byte]: at the most twice what `datagram_size` says of the rate [byte/s]."""
        fit, halved = datagram_size(rate, self._most), 0
        while self._most >> halved + 1 >= fit:
            halved += 1
        if halved > self._halved or self._most >> max(0, self._halved - 1) <= fit:
            self._halved = halved
        return self._most >> self._halved


class Thinning:
    """Halves what protected streams send, and halves it again, where they leave too little of a slow link to others."""

    def __init__(self):
        self.part = 1.0
        """Of their rates."""
        self._changed = self._since = -math.inf
        self._next = 1.0        # what would be right, and since when

    def follow(self, budget, protected, now):
        """The part of their rates that protected streams are to have.

        :param budget: of the link [byte/s]
        :param protected: what they take of it, as they are thinned [byte/s]
        :param now: by a steady clock [s]
        """
        if now - self._changed < THINNED_FOR:
            return self.part        # what they take was measured before
        whole, part = protected / self.part, THINNEST
        while part < 1 and 2 * part * whole <= PROTECTED_PART * budget:
            part *= 2
        if part != self._next:
            self._next, self._since = part, now
        if part != self.part and now - self._since >= (HOLD if part < self.part else THINNED_FOR):
            self.part, self._changed = part, now
        return self.part


def shares(budget, demands):
    """Divide a budget: floors first, what is left by weights, nobody more than it can use.

    :param budget: [byte/s]
    :param demands: {stream: Demand}
    :return: {stream: byte/s}, together at most the budget
    """
    most = {name: demand.levels[-1].cost for name, demand in demands.items()}
    floors = {name: min(demand.floor, most[name]) for name, demand in demands.items()}
    fits = min(1.0, budget / sum(floors.values())) if any(floors.values()) else 1.0
    granted = {name: floor * fits for name, floor in floors.items()}
    left = max(0.0, budget - sum(granted.values()))
    # fill like water: who needs least for its weight is full first
    open_ = sorted((name for name in demands if demands[name].weight > 0),
                   key=lambda name: (most[name] - granted[name]) / demands[name].weight)
    weights = math.fsum(demands[name].weight for name in open_)
    for name in open_:
        more = min(most[name] - granted[name], left * min(1.0, demands[name].weight / weights))
        granted[name] += more
        left -= more
        weights = max(weights - demands[name].weight, demands[name].weight * 1e-9)
    return granted


class Allocator:
    """Divides the link again and again, without flicker."""

    def __init__(self):
        self._levels: Dict[str, int] = {}       # as granted last; -1: none
        self._waits: Dict[str, float] = {}      # since when a stream could have more [s]

    def forget(self):
        """The focus has changed: all is divided anew, without a wait."""
        self._levels.clear()
        self._waits.clear()

    def allocate(self, budget, demands, protected, now):
        """Divide a budget.

        :param budget: of the link [byte/s]
        :param demands: {stream: Demand} of those that are enabled and not protected
        :param protected: what protected streams take now [byte/s]
        :param now: by a steady clock [s]
        :return: {stream: Grant}; all costs together are at most the budget less what is protected
        """
        budget = max(0.0, budget - protected)
        granted = shares(budget, demands)
        cautious = shares(budget / MARGIN, demands)
        best = self._levels_for(budget, granted, demands)
        sure = self._levels_for(budget / MARGIN, cautious, demands)
        leaps = budget > LEAP * math.fsum(_cost(demand, self._levels.get(name, -1)) for name, demand in demands.items())
        grants = {}
        for name, demand in demands.items():
            level = self._steady(name, best[name], sure[name], leaps, now)
            settings, cost = demand.levels[level] if level >= 0 else ({}, 0.0)
            grants[name] = Grant(granted[name], level if level >= 0 else None, settings, cost)
        self._levels = {name: -1 if grant.level is None else grant.level for name, grant in grants.items()}
        self._waits = {name: since for name, since in self._waits.items() if name in demands}
        return grants

    def _levels_for(self, budget, granted, demands):
        """{stream: level}, the best that shares and what they leave over pay for."""
        levels = {name: _affordable(demand.levels, granted[name]) for name, demand in demands.items()}
        left = budget - math.fsum(_cost(demands[name], level) for name, level in levels.items())
        # what one had before it keeps sooner than another gets more
        for name, demand in sorted(demands.items(), key=lambda item: (
                self._levels.get(item[0], -1) <= levels[item[0]], -item[1].weight)):
            if demand.weight > 0:
                better = _affordable(demand.levels, _cost(demand, levels[name]) + left * (1 - 1e-9))
                left -= _cost(demand, better) - _cost(demand, levels[name])
                levels[name] = better
        return levels

    def _steady(self, name, best, sure, leaps, now):
        """The level to take: no better than `best`."""
        before = self._levels.get(name)
        if before is None or best <= before:
            self._waits.pop(name, None)
            return best
        if sure <= before:
            self._waits.pop(name, None)
            return before
        if now - self._waits.setdefault(name, now) < (0 if leaps else HOLD):
            return before
        del self._waits[name]
        return min(best, sure)


def _affordable(levels, share):
    """The best level that a share pays for; -1: none."""
    return max((at for at, level in enumerate(levels) if level.cost <= share), default=-1)


def _cost(demand, level):
    return demand.levels[min(level, len(demand.levels) - 1)].cost if level >= 0 else 0.0
