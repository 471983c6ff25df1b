# SPDX-License-Identifier: BSD-3-Clause
"""The robot's link controller: reports in, a plan for all streams out. Times are arguments, by a steady clock.

Its owner calls `on_sent` for all that leaves, `on_report` for each report, and `tick` each estimator.REPORT_INTERVAL;
it sets the packet scheduler's rate after each of the latter two. The nodes and the simulator are such owners.

Each operator that reports has an estimate of its own, and the worst link counts: all operators get the same datagrams.
"""
import collections
import math
from dataclasses import dataclass, replace
from typing import Any, Counter, Dict, Mapping, Optional, Tuple

from ..monitoring.stats import LinkStats
from ..monitoring.windows import Rate
from .allocation import Allocator, DatagramSize, Decimation, Demand, Grant
from .estimator import Estimator, Limits
from .feedback import FeedbackReader
from .probing import ProbeTrain
from .sent_history import SentHistory

__all__ = ['Controller', 'Demand', 'Plan']

PLANNING_SHARE = 0.92
"""Part of the capacity that is allocated. An image that needs the whole frame period to leave is cut off by the next
one; and the estimate fluctuates."""

RATE_LIMIT_FACTOR = 0.95
"""A granted rate above this part of the requested rate (or of the source's) is no limit."""

GRANT_TOLERANCE = 0.02
"""A setting keeps the value granted before where the new one differs by less than this ratio."""

MAX_OPERATORS = 8
"""Reports of further ones are ignored: they come from the network, and each operator costs memory."""

OPERATOR_TIMEOUT = 10.0
"""An operator that did not report for this long no longer counts, where others do [s]."""

SENT_WINDOW = 1.0
"""Window over which the rate sent is measured [s],"""

PROTECTED_WINDOW = 2.0
"""and that of the protected streams [s]."""


@dataclass
class Plan:
    """What a tick decides."""
    rate: Optional[float]
    """Of all streams together; None: unlimited [byte/s]."""
    datagram_size: int
    """As the controller's max_datagram_size counts it [byte]."""
    shares: Dict[str, float]
    """Of the streams with a demand; empty: unlimited [byte/s]."""
    grants: Dict[str, Optional[Dict[str, Any]]]
    """{stream: settings that limit it}, of the streams with a demand; {}: nothing does, None: it has to pause."""
    decimation: float
    """Part of their rates that protected streams keep."""


class _Operator:
    """What is known of the link to one operator."""

    def __init__(self, history: SentHistory, limits: Limits, now: float) -> None:
        self.reader, self.estimator = FeedbackReader(history), Estimator(now, limits)
        self.heard = now
        self.confirmed = False      # whether it ever reported a datagram that was sent


class Controller:
    """Decides the rate of all streams together, and the settings of each.

    :param limits: bounds of the rate
    :param adapt: whether the rate follows the reports; otherwise it is limits.max_rate, and reports are only measured
    :param max_datagram_size: on a fast link [byte]
    """

    def __init__(self, limits: Limits, adapt: bool, max_datagram_size: int) -> None:
        self._limits, self._adapt = limits, adapt
        self._history = SentHistory()
        self._operators: Dict[str, _Operator] = {}
        self._surplus_reports = 0
        self._sent, self._protected = Rate(SENT_WINDOW), Rate(PROTECTED_WINDOW)
        self._wanted = math.inf
        self._datagram_size, self._decimation = DatagramSize(max_datagram_size), Decimation()
        self._allocator = Allocator()
        self._grants: Dict[str, Optional[Dict[str, Any]]] = {}      # as in the last plan

    def on_sent(self, stream: str, seq: int, count: int, size: int, now: float) -> None:
        """Record datagrams that were sent together.

        :param stream: its name
        :param seq: sequence number of the first one; the others follow without a gap
        :param count: number of datagrams
        :param size: of each on the air, IP and UDP headers included [byte]
        :param now: when [s]
        """
        self._history.add(stream, seq, count, size, now)

    def on_report(self, operator: str, report: Any, now: float) -> Optional[ProbeTrain]:
        """Take an operator's report; a forged or impossible one is counted and ignored.

        :param operator: its name
        :param report: a feedback.Report or a LinkReport message
        :param now: when it came [s]
        :return: a train for the packet scheduler, if one is due
        """
        state = self._operator(operator, now)
        feedback = state.reader.read(report, now) if state else None
        if state is None or feedback is None:
            return None
        state.heard = now
        state.confirmed |= bool(feedback.samples)
        train = state.estimator.on_feedback(feedback, now, self._wanted)
        return train if self._adapt else None

    def tick(self, now: float, demands: Mapping[str, Demand], protected_bytes: int) -> Plan:
        """Make the plan for the time until the next tick.

        :param now: [s]
        :param demands: of the streams that have something to send to somebody, and are not protected
        :param protected_bytes: that protected streams ever sent, IP and UDP headers included
        """
        self._sent.read(self._history.total, now)
        self._protected.read(protected_bytes, now)
        for operator in self._operators.values():
            operator.estimator.poll(now)
        protected = self._protected.per_second or 0.0
        self._wanted = protected + math.fsum(demand.points[-1].cost for demand in demands.values())
        # a dip in the rate soon passes: streams are allocated the capacity
        capacity = self._capacity(now)
        shares, self._grants = self._divide(capacity, demands, protected, now)
        unlimited = math.inf if capacity is None else capacity
        return Plan(self.rate(now), self._datagram_size.update(unlimited), shares, dict(self._grants),
                    self._decimation.update(unlimited, protected, now))

    def forget(self) -> None:
        """The mission focus changed: the next tick divides the link at once, without hysteresis."""
        self._allocator.forget()
        self._grants = {}

    def rate(self, now: float) -> Optional[float]:
        """What may be sent now, of all streams together [byte/s]; None: unlimited."""
        worst = self._worst(now) if self._adapt else None
        return worst[1].estimator.rate if worst else self._initial_rate()

    def stats(self, now: float) -> LinkStats:
        """The state for status and diagnostics."""
        refused: Counter[str] = collections.Counter()
        for operator in self._operators.values():
            refused.update(operator.reader.dropped)
        if self._surplus_reports:
            refused['too many operators'] = self._surplus_reports
        stats = LinkStats(self._adapt, self.rate(now), self._sent.per_second or 0.0, self._wanted,
                          refused_reports=dict(refused))
        worst = self._worst(now)
        if worst is None:
            return stats
        name, state = worst
        link = state.estimator.link
        return replace(stats, capacity=link.capacity, loss=link.loss, queue_delay=link.queue_delay,
                       round_trip=link.round_trip, operator=name, silence=now - state.heard,
                       timeout=self._adapt and state.estimator.timeouts > 0)

    def _operator(self, name: str, now: float) -> Optional[_Operator]:
        """The operator's state; None: there are too many operators."""
        if name not in self._operators:
            self._operators = {other: state for other, state in self._operators.items()
                               if now - state.heard <= OPERATOR_TIMEOUT}
            if len(self._operators) >= MAX_OPERATORS:
                self._surplus_reports += 1
                return None
            self._operators[name] = _Operator(self._history, self._limits, now)
        return self._operators[name]

    def _worst(self, now: float) -> Optional[Tuple[str, _Operator]]:
        """The operator with the lowest rate; None: none has reported a datagram that was sent."""
        confirmed = [item for item in self._operators.items() if item[1].confirmed]
        present = [item for item in confirmed if now - item[1].heard <= OPERATOR_TIMEOUT] or confirmed
        return min(present, key=lambda item: item[1].estimator.rate) if present else None

    def _initial_rate(self) -> Optional[float]:
        """Without reports [byte/s]; None: unlimited."""
        limits = self._limits
        rate = min(limits.start_rate, limits.max_rate) if self._adapt else limits.max_rate
        return rate if rate < math.inf else None

    def _capacity(self, now: float) -> Optional[float]:
        """[byte/s]; None: unlimited."""
        worst = self._worst(now) if self._adapt else None
        return worst[1].estimator.link.capacity if worst else self._initial_rate()

    def _divide(self, capacity: Optional[float], demands: Mapping[str, Demand], protected: float,
                now: float) -> Tuple[Dict[str, float], Dict[str, Optional[Dict[str, Any]]]]:
        """(shares, grants) as in a Plan."""
        if capacity is None:
            return {}, {name: {} for name in demands}
        budget = PLANNING_SHARE * capacity
        allocated = self._allocator.allocate(budget, demands, protected, now)
        limited = {name for name, grant in allocated.items()
                   if grant.point is not None and grant.point < len(demands[name].points) - 1}
        spare = max(0.0, budget - protected - math.fsum(grant.cost for grant in allocated.values()))
        weights = math.fsum(demands[name].weight for name in limited)
        grants: Dict[str, Optional[Dict[str, Any]]] = {}
        for name, grant in allocated.items():
            if name in limited:
                part = spare * demands[name].weight / weights if weights else 0.0
                grants[name] = self._limiting_settings(name, grant, demands[name], part)
            else:
                grants[name] = None if grant.point is None else {}
        return {name: grant.share for name, grant in allocated.items()}, grants

    def _limiting_settings(self, name: str, grant: Grant, demand: Demand, spare: float) -> Dict[str, Any]:
        """An operating point's settings, refined; those granted before where they are nearly the same."""
        before = self._grants.get(name) or {}
        return {setting: _steady(before.get(setting), value)
                for setting, value in demand.refine(grant.settings, spare).items()
                if setting != 'rate' or value < RATE_LIMIT_FACTOR * demand.rate}


def _steady(before: Any, value: Any) -> Any:
    """The value granted before, if the new one is within GRANT_TOLERANCE of it."""
    numbers = isinstance(before, (int, float)) and isinstance(value, (int, float))
    return before if numbers and math.isclose(before, value, rel_tol=GRANT_TOLERANCE) else value
