# SPDX-License-Identifier: BSD-3-Clause
"""Divides the link among the streams, and turns each stream's share into an operating point.

Protected streams are served first. Then each stream gets its min_bitrate; the rest is divided by weight, and what a
stream cannot use goes to the others. A share buys the best operating point that it pays for; bandwidth left over
between points buys the cheapest point of each stream whose share buys none, then upgrades others. Downgrades are
immediate, because the link has no more. An upgrade needs a link that would pay for more than the next point, for some
time, or for much more.
"""
import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional

from .operating_points import OperatingPoint

UPGRADE_MARGIN = 1.05
"""An upgrade needs a budget that is larger than its cost by this factor."""

UPGRADE_DELAY = 1.0
"""Time for which the budget must pay for an upgrade before it is made, and for which deeper decimation must be due
before it is applied [s]."""

LEAP_FACTOR = 1.5
"""An upgrade is immediate where the budget is this many times all present costs."""

MAX_DATAGRAM_DURATION = 0.012
"""A datagram occupies the link for this long at most, unless it has MIN_DATAGRAM_SIZE [s]."""

MIN_DATAGRAM_SIZE = 400
"""Datagrams are not made shorter than this on slow links [byte]."""

MAX_PROTECTED_PART = 0.4
"""Where protected streams use more of the link than this, their rates are decimated: a link that is full of odometry
shows no image."""

MIN_DECIMATION = 0.25
"""Part of their rates that protected streams keep, at least."""

DECIMATION_HOLD = 3.0
"""Decimation stays for this long after a change: its effect is measured over 2 s [s]."""

PLENTY = 4.0
"""Where the link has room for this many times what protected streams would send, decimation ends at once."""


def _unrefined(settings: Mapping[str, Any], spare: float) -> Dict[str, Any]:
    return dict(settings)


@dataclass
class Demand:
    """What a stream would send."""
    points: List[OperatingPoint]
    """Its operating points, the cheapest first; at least one."""
    weight: float = 1.0
    """Its part of the bandwidth left after min_bitrates, relative to the other streams' weights."""
    min_bitrate: float = 0.0
    """Bitrate that it gets before weights count [byte/s]."""
    rate: float = math.inf
    """Rate of its messages, as requested or of the source, whichever is lower [Hz]."""
    refine: Callable[[Mapping[str, Any], float], Dict[str, Any]] = _unrefined
    """f(settings of a point, spare [byte/s]) -> settings, improved by bandwidth left over (Encoder.refine)."""
    whole: bool = False
    """Whether a message is useless without all its datagrams."""
    is_base: bool = False
    """Whether its `base` is worth a path whose bytes cost."""
    wished: float = 0.0
    """A link of this rate would show its messages sooner, however much is sent: it is probed for [byte/s]."""

    @property
    def base(self) -> float:
        """What its cheapest messages take, were none left out [byte/s]."""
        settings, cost = self.points[0]
        return cost * max(1.0, self.rate / settings['rate']) if 'rate' in settings else cost


class Grant(NamedTuple):
    """What a stream gets."""
    share: float
    """Bandwidth allocated to it [byte/s]."""
    point: Optional[int]
    """Index of the operating point; None: the share does not even pay for the cheapest."""
    settings: Dict[str, Any]
    """Settings of the operating point; empty without one."""
    cost: float
    """Cost of the operating point; 0 without one [byte/s]."""


def datagram_size(rate: float, max_size: int) -> int:
    """The size of datagrams on a link: short on a slow one, for the sake of those that wait behind [byte].

    :param rate: of the link [byte/s]
    :param max_size: on a fast link [byte]
    """
    return int(min(max_size, max(MIN_DATAGRAM_SIZE, rate * MAX_DATAGRAM_DURATION)))


class DatagramSize:
    """Halves datagrams, repeatedly, on a slow link, with hysteresis.

    :param max_size: [byte]
    """

    def __init__(self, max_size: int) -> None:
        self._max_size, self._halvings = max_size, 0

    def update(self, rate: float) -> int:
        """The size to use now: less than twice `datagram_size` of the link's rate in byte/s [byte]."""
        fit, halvings = datagram_size(rate, self._max_size), 0
        while self._max_size >> halvings + 1 >= fit:
            halvings += 1
        if halvings > self._halvings or self._max_size >> max(0, self._halvings - 1) <= fit:
            self._halvings = halvings
        return self._max_size >> self._halvings


class Decimation:
    """Halves the rates of protected streams, repeatedly, where they leave too little of a slow link to the others."""

    def __init__(self) -> None:
        self.part = 1.0
        """Part of their rates that protected streams keep."""
        self._changed = self._candidate_since = -math.inf
        self._candidate = 1.0

    def update(self, capacity: float, protected: float, now: float) -> float:
        """The part of their rates that protected streams keep now.

        :param capacity: of the link [byte/s]
        :param protected: what they send, as decimated now [byte/s]
        :param now: by a steady clock [s]
        """
        if self.part < 1 and PLENTY * protected / self.part <= MAX_PROTECTED_PART * capacity:
            self.part, self._changed = 1.0, now
        if now - self._changed < DECIMATION_HOLD:
            return self.part        # `protected` was measured before the change took effect
        whole, part = protected / self.part, MIN_DECIMATION
        while part < 1 and 2 * part * whole <= MAX_PROTECTED_PART * capacity:
            part *= 2
        if part != self._candidate:
            self._candidate, self._candidate_since = part, now
        hold = UPGRADE_DELAY if part < self.part else DECIMATION_HOLD
        if part != self.part and now - self._candidate_since >= hold:
            self.part, self._changed = part, now
        return self.part


def shares(budget: float, demands: Mapping[str, Demand]) -> Dict[str, float]:
    """Divide a budget: min_bitrates first, the rest by weight, no stream more than it can use (water-filling).

    :param budget: [byte/s]
    :return: {stream: byte/s}, the budget at most in total
    """
    most = {name: demand.points[-1].cost for name, demand in demands.items()}
    least = {name: min(demand.min_bitrate, most[name]) for name, demand in demands.items()}
    scale = min(1.0, budget / sum(least.values())) if any(least.values()) else 1.0
    granted = {name: bitrate * scale for name, bitrate in least.items()}
    left = max(0.0, budget - sum(granted.values()))
    # those that need least for their weight are full first
    order = sorted((name for name in demands if demands[name].weight > 0),
                   key=lambda name: (most[name] - granted[name]) / demands[name].weight)
    weights = math.fsum(demands[name].weight for name in order)
    for name in order:
        more = min(most[name] - granted[name], left * min(1.0, demands[name].weight / weights))
        granted[name] += more
        left -= more
        weights = max(weights - demands[name].weight, demands[name].weight * 1e-9)
    return granted


class Allocator:
    """Divides the link repeatedly, with hysteresis."""

    def __init__(self) -> None:
        self._points: Dict[str, int] = {}           # as granted last; -1: none
        self._waiting_since: Dict[str, float] = {}  # since when a stream could be upgraded [s]

    def forget(self) -> None:
        """Forget the last division: the mission focus changed, and the next division applies at once."""
        self._points.clear()
        self._waiting_since.clear()

    def allocate(self, budget: float, demands: Mapping[str, Demand], protected: float, now: float) -> Dict[str, Grant]:
        """Divide a budget.

        :param budget: for all streams [byte/s]
        :param demands: of the streams that have something to send and are not protected
        :param protected: what protected streams send now [byte/s]
        :param now: by a steady clock [s]
        :return: all costs together are at most the budget less what is protected
        """
        budget = max(0.0, budget - protected)
        granted, cautious = shares(budget, demands), shares(budget / UPGRADE_MARGIN, demands)
        best = self._best_points(budget, granted, demands)
        certain = self._best_points(budget / UPGRADE_MARGIN, cautious, demands)
        spent = math.fsum(_cost(demand, self._points.get(name, -1)) for name, demand in demands.items())
        delay = 0.0 if budget > LEAP_FACTOR * spent else UPGRADE_DELAY
        grants = {}
        for name, demand in demands.items():
            point = self._point(name, best[name], certain[name], delay, now)
            settings, cost = demand.points[point] if point >= 0 else ({}, 0.0)
            grants[name] = Grant(granted[name], point if point >= 0 else None, settings, cost)
        self._points = {name: -1 if grant.point is None else grant.point for name, grant in grants.items()}
        self._waiting_since = {name: since for name, since in self._waiting_since.items() if name in demands}
        return grants

    def _best_points(self, budget: float, granted: Mapping[str, float],
                     demands: Mapping[str, Demand]) -> Dict[str, int]:
        """{stream: index of the best point that the shares, and what they leave over, pay for; -1: none}"""
        points = {name: _affordable(demand, granted[name]) for name, demand in demands.items()}
        left = budget - math.fsum(_cost(demands[name], point) for name, point in points.items())
        before, ends = self._points, {name: len(demand.points) - 1 for name, demand in demands.items()}
        order = sorted((name for name in demands if demands[name].weight > 0), key=lambda name: -demands[name].weight)
        # every stream shows something before another one keeps its last point, and keeps it before another is upgraded
        for limits in {name: 0 for name in demands}, before, ends:
            for name in order:
                demand, point = demands[name], points[name]
                better = min(limits.get(name, -1), _affordable(demand, _cost(demand, point) + left * (1 - 1e-9)))
                if better > point:
                    left -= _cost(demand, better) - _cost(demand, point)
                    points[name] = better
        return points

    def _point(self, name: str, best: int, certain: int, delay: float, now: float) -> int:
        """The point to take, `best` at most: downgrades at once, upgrades after a delay [s]."""
        before = self._points.get(name)
        if before is None or best <= before:
            self._waiting_since.pop(name, None)
            return best
        if certain <= before:
            self._waiting_since.pop(name, None)
            return before
        if now - self._waiting_since.setdefault(name, now) < delay:
            return before
        del self._waiting_since[name]
        return min(best, certain)


def _affordable(demand: Demand, share: float) -> int:
    """Index of the best point that a share pays for; -1: none."""
    return max((index for index, point in enumerate(demand.points) if point.cost <= share), default=-1)


def _cost(demand: Demand, point: int) -> float:
    return demand.points[min(point, len(demand.points) - 1)].cost if point >= 0 else 0.0
