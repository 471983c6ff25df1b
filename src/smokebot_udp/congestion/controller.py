# SPDX-License-Identifier: BSD-3-Clause
"""The robot's link controller: reports in, a plan for all streams out. Times are arguments, by a steady clock.

Its owner calls `on_sent` for all that leaves, `on_report` for each report, and `tick` each estimator.REPORT_INTERVAL;
it sets the packet scheduler's rate after each of the latter two. The nodes and the simulator are such owners.

Each operator that reports has an estimate of its own, of each path to it that is used (bundle.py). All operators get
the same datagrams; the streams are planned for the best link, and for those that carry nearly as much. The owner asks
`route` before datagrams leave: an operator with a slower link gets the part of them that its link carries
(operator_share.py), and slows nobody else. An owner that knows the subscribers calls `on_operators` before `tick`:
who left no longer counts, and nobody else's reports do.
"""
import collections
import math
from dataclasses import dataclass, field, replace
from typing import Any, Callable, Counter, Dict, List, Mapping, Optional, Sequence, Tuple

from ..monitoring.stats import LinkStats
from ..monitoring.windows import Rate
from ..paths import STRAIGHT, PathUse, Route
from .allocation import Allocator, DatagramSize, Decimation, Demand, Grant
from .allocation import shares as divide
from .bundle import SENT_WINDOW, Bundle
from .estimator import MAX_GAIN, Limits
from .operating_points import OperatingPoint
from .operator_share import Policer
from .sent_history import SentHistory, stream_of
from .trains import Train

__all__ = ['Controller', 'Demand', 'Plan']

PLANNING_SHARE = 0.96
"""Part of the capacity that is allocated. An image that needs the whole frame period to leave is cut off by the next
one; and the estimate fluctuates."""

REFILL_SHARE = 0.9
"""The same where the path has a token bucket that takes this long to fill: what is left fills it, and what fits into it
passes at once. At 0.96 an image of 0.1 s at 0.3 Mbit/s takes 40 to 60 ms to pass a bucket of 6 kB, at 0.88 one
(evaluation/simulated_paths.py) [1, s]."""

RATE_LIMIT_FACTOR = 0.95
"""A granted rate above this part of the requested rate (or of the source's) is no limit."""

GRANT_TOLERANCE = 0.02
"""A setting keeps the value granted before where the new one differs by less than this ratio."""

MAX_OPERATORS = 8
"""Reports of further ones are ignored: they come from the network, and each operator costs memory."""

OPERATOR_TIMEOUT = 10.0
"""An operator that did not report for this long no longer counts, where others do [s]."""

NEAR = 0.75
"""The plan includes a link once it carries at least this part of what the best one does."""

STILL_NEAR = 0.55
"""The plan includes a link for as long as it carries at least this part of what the best one does. The part is lower
than NEAR because a better link that is not used is assumed to carry more than is sent."""

JOIN_TIME = 2.0
"""Until its first report, but no longer than this, a new operator beside others gets start_rate [s]."""

SOURCE_TIMEOUT = 1.0
"""While reports of an operator come, those of another connection under its name are ignored; after this long without,
they are not [s]."""

PROTECTED_WINDOW = 2.0
"""Window over which the send rate of the protected streams is measured [s]."""


OnArrivals = Callable[[str, str, int, int, float], None]
"""f(operator, stream, expected, received, now): of `expected` datagrams sent, `received` arrived (feedback.Arrivals)"""


@dataclass
class Plan:
    """What a tick decides."""
    rate: Optional[float]
    """Rate of all streams together; None: unlimited [byte/s]."""
    datagram_size: int
    """Maximum size of datagrams, counted as in the controller's max_datagram_size [byte]."""
    shares: Dict[str, float]
    """{stream: its share of the link}, for the streams with a demand; empty: unlimited [byte/s]."""
    grants: Dict[str, Optional[Dict[str, Any]]]
    """{stream: settings that limit it}, of the streams with a demand; {}: nothing does, None: it has to pause."""
    decimation: float
    """Part of their rates that protected streams keep."""
    rooms: Dict[str, float] = field(default_factory=dict)
    """{stream: the most that it may use while the others use what they are granted}, for the streams with a demand;
    empty: unlimited. While a train leaves they may use more, see `Controller.gain` [byte/s]."""


class _Operator:
    """What is known of the link to one operator."""

    def __init__(self, history: SentHistory, limits: Limits, now: float) -> None:
        self.paths, self.policer = Bundle(history, limits, now), Policer(now)
        self.heard, self.since = now, now
        self.source: Any = None
        self.doubted = -math.inf    # when it lost a connection
        self.near = False           # whether the plan suits its link
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
        self._connections: Optional[Mapping[str, int]] = None       # {operator: number}; None: unknown
        self._ignored: Counter[str] = collections.Counter()     # reports, by reason
        self._sent, self._protected = Rate(SENT_WINDOW), Rate(PROTECTED_WINDOW)
        self._stream_sent: Dict[str, Rate] = {}
        self._wanted, self._wished = math.inf, 0.0
        self._datagram_size, self._decimation = DatagramSize(max_datagram_size), Decimation()
        self._allocator = Allocator()
        self._grants: Dict[str, Optional[Dict[str, Any]]] = {}      # as in the last plan
        self.on_arrivals: OnArrivals = lambda *_: None
        """Called with what each valid report says about each stream."""

    def route(self, stream: str, count: int, size: int, now: float, start: int = 0, total: int = 1,
              waiting: float = 0.0, whole: bool = False) -> Route:
        """Who gets which of the datagrams that leave together now: operators with slower links get the first ones only.

        :param stream: its name
        :param count: number of datagrams
        :param size: of each on the air, IP and UDP headers included [byte]
        :param start: index in its message of the first datagram
        :param total: datagrams of the message
        :param waiting: size of all that waits, as Chunk has it; 0: nothing else does [byte]
        :param whole: whether all operators get all
        """
        second, withheld = (), 0.0      # type: Tuple[str, ...], float
        for name, state in self._operators.items():
            chosen, amount = state.paths.choose(count * size, max(waiting, count * size), now)
            withheld = max(withheld, amount)
            if chosen:
                second += (name,)
        rate = self.rate(now) if self._adapt and not whole and len(self._operators) > 1 else None
        if rate is None:
            return Route(second=second, withheld=withheld) if second or withheld else STRAIGHT
        numbers = {name: state.policer.conforming(stream, count, size, state.paths.rate, now, start, total)
                   for name, state in self._operators.items() if state.paths.rate < rate
                   and (state.confirmed or now - state.since < JOIN_TIME)}
        return Route({name: number for name, number in numbers.items() if number < count}, second, withheld)

    def on_sent(self, stream: str, seq: int, count: int, size: int, now: float, route: Route = STRAIGHT) -> None:
        """Record datagrams that were sent together.

        :param stream: its name in reports, see sent_history.py
        :param seq: sequence number of the first one; the others follow without a gap
        :param count: number of datagrams
        :param size: of each on the air, IP and UDP headers included [byte]
        :param now: when [s]
        :param route: that they took
        """
        self._history.add(stream, seq, count, size, now)
        for name, state in self._operators.items():
            number = route.limits.get(name, count)
            state.policer.spend(number * size)
            state.paths.sent(stream, seq, count, number, size, now, int(name in route.second))

    def on_sent_besides(self, size: int) -> None:
        """Record what was sent to all operators and is in no report: it shares the air, too.

        :param size: on the air, IP and UDP headers included [byte]
        """
        self._history.add_besides(size)

    def on_operators(self, connections: Mapping[str, int], now: float) -> None:
        """Take the operators that the streams are sent to now; the others no longer count.

        Connections end one after another, as streams send. An operator that lost one does not count before it reports
        again. One that comes back has not been silent until now.

        :param connections: {operator as in `on_report`: number of its connections}; without any, the last operators
            count until there are others
        """
        before = self._connections or {}
        lost = {name for name, number in before.items() if connections.get(name, 0) < number}
        for name, state in self._operators.items():
            if connections.get(name) and not before.get(name):
                state.paths.on_return(now)
            if name in lost:
                state.doubted = now
            elif lost:
                state.paths.expect_more()
        self._connections = dict(connections)
        for name in connections:
            self._state(name, now)

    def on_paths(self, paths: Mapping[str, Sequence[PathUse]], now: float) -> bool:
        """Take how the operators are reached now. An operator that is reached by another path has the estimate that
        this one had last; a path that is new begins with start_rate. What was sent before says nothing about it.

        :param paths: {operator as in `on_report`: its first path, and a second one if it has one}
        :param now: [s]
        :return: whether the paths to an operator carry far less than before
        """
        followed = [self._operators[name].paths.follow(used, now)
                    for name, used in paths.items() if name in self._operators]
        return any(followed)

    def on_report(self, operator: str, report: Any, now: float, source: Any = None, path: int = 0) -> Optional[Train]:
        """Take an operator's report; a forged or impossible one is counted and ignored.

        :param operator: its name
        :param report: a feedback.Report or a LinkReport message
        :param now: when it came [s]
        :param source: the connection that it came by
        :param path: index of the path that it is about
        :return: a train for the packet scheduler, if one is due
        """
        state = self._operator(operator, source, now)
        feedback = state.paths.read(report, path, now) if state else None
        if state is None or feedback is None:
            return None
        state.heard = now
        state.confirmed |= bool(feedback.samples)
        for one in feedback.arrivals:
            self.on_arrivals(operator, stream_of(one.stream), one.expected, one.received, now)
        train = state.paths.on_feedback(path, feedback, now, self._wanted, self._wished)
        if train is None or not self._adapt:
            return None
        state.policer.start_probe(*train)
        return train if state.paths.rate_beside(path) + train.rate > (self.rate(now) or math.inf) else None

    def tick(self, now: float, demands: Mapping[str, Demand], protected_bytes: int) -> Plan:
        """Make the plan for the time until the next tick.

        :param now: [s]
        :param demands: of the streams that have something to send to somebody, and are not protected
        :param protected_bytes: that protected streams ever sent, IP and UDP headers included
        """
        self._sent.read(self._history.total, now)
        self._protected.read(protected_bytes, now)
        protected = self._protected.per_second or 0.0
        base = protected + math.fsum(demand.base for demand in demands.values() if demand.is_base)
        for operator in self._operators.values():
            operator.paths.base = base
            operator.paths.poll(now, (self._sent.per_second or 0.0) + protected)
        self._find_near(now)
        self._wanted = protected + math.fsum(demand.points[-1].cost for demand in demands.values())
        self._wished = max((demand.wished for demand in demands.values()), default=0.0)
        # a dip in the rate soon passes: streams are allocated the capacity
        capacity = self._capacity(now)
        shares, rooms, self._grants = self._divide(capacity, demands, protected, now)
        self._divide_slower_links(demands, protected, now)
        unlimited = math.inf if capacity is None else capacity
        return Plan(self.rate(now), self._datagram_size.update(unlimited), shares, dict(self._grants),
                    self._decimation.update(unlimited, protected, now), rooms)

    def forget(self) -> None:
        """The mission focus changed: the next tick divides the link at once, without hysteresis."""
        self._allocator.forget()
        self._grants = {}

    def rate(self, now: float) -> Optional[float]:
        """What may be sent now, of all streams together [byte/s]; None: unlimited."""
        counting = self._counting(now) if self._adapt else []
        if not counting:
            return self._initial_rate()
        rates = [state.paths.rate for _, state in counting]
        return min(max(rates), MAX_GAIN * self._planned(counting)[1].paths.capacity)

    def tokens(self, now: float) -> Tuple[float, float]:
        """(depth of a token bucket on all paths that the streams are planned for, tokens missing in it now) [byte]."""
        found = [state.paths.tokens(now)
                 for _, state in self._counting(now) if state.near] if self._adapt else []
        return min(found, default=(0.0, 0.0))

    def stats(self, now: float) -> LinkStats:
        """The state for status and diagnostics."""
        refused = collections.Counter(self._ignored)
        for operator in self._operators.values():
            for reader in operator.paths.readers:
                refused.update(reader.dropped)
        stats = LinkStats(self._adapt, self.rate(now), self._sent.per_second or 0.0, self._wanted,
                          refused_reports=dict(refused))
        counting = self._counting(now)
        if not counting:
            return stats
        name, state = self._planned(counting)
        link = state.paths.link
        return replace(stats, capacity=link.capacity, loss=link.loss, queue_delay=link.queue_delay,
                       round_trip=link.round_trip, operator=name, only=state.paths.only, silence=now - state.heard,
                       paths=state.paths.shares(stats.sent),
                       timeout=self._adapt and state.paths.timed_out,
                       slower={other: slow.paths.rate for other, slow in counting
                               if self._adapt and not slow.near and other != name})

    def _operator(self, name: str, source: Any, now: float) -> Optional[_Operator]:
        """The state of the operator that reports; None: its report does not count."""
        if self._connections is not None and name not in self._connections:
            self._ignored['not of an operator'] += 1
            return None
        state = self._state(name, now)
        if state is None:
            self._ignored['too many operators'] += 1
            return None
        if state.source != source:
            if state.source is not None and now - state.heard < SOURCE_TIMEOUT:
                self._ignored["under another operator's name"] += 1
                return None
            state.source = source
        return state

    def _state(self, name: str, now: float) -> Optional[_Operator]:
        """An operator's state, new if it is unknown; None: there are too many operators."""
        if name not in self._operators:
            self._operators = {other: state for other, state in self._operators.items()
                               if now - state.heard <= OPERATOR_TIMEOUT}
            unconfirmed = [other for other, state in self._operators.items() if not state.confirmed]
            if len(self._operators) >= MAX_OPERATORS and unconfirmed:
                del self._operators[unconfirmed[0]]
            if len(self._operators) < MAX_OPERATORS:
                self._operators[name] = _Operator(self._history, self._limits, now)
        return self._operators.get(name)

    def _counting(self, now: float) -> List[Tuple[str, _Operator]]:
        """The operators that have reported a datagram that was sent; only those that are there, and that report, if
        any does."""
        counting = [item for item in self._operators.items()
                    if item[1].confirmed and (not self._connections or item[0] in self._connections)]
        trusted = [item for item in counting if item[1].heard > item[1].doubted] or counting
        return [item for item in trusted if now - item[1].heard <= OPERATOR_TIMEOUT] or trusted

    def _find_near(self, now: float) -> None:
        """Find out which links carry nearly as much as the best one."""
        counting = self._counting(now)
        best = max((state.paths.capacity for _, state in counting), default=0.0)
        for _, state in counting:
            state.near = state.paths.capacity >= (STILL_NEAR if state.near else NEAR) * best

    def _planned(self, counting: List[Tuple[str, _Operator]]) -> Tuple[str, _Operator]:
        """The operator for whose link the streams are planned: the slowest that is near, else the best."""
        near = [item for item in counting if item[1].near]
        if not near:
            return max(counting, key=lambda item: item[1].paths.capacity)
        return min(near, key=lambda item: item[1].paths.capacity)

    def _planned_paths(self, now: float) -> Optional[Bundle]:
        """The link that the streams are planned for; None: the rate does not follow any link."""
        counting = self._counting(now) if self._adapt else []
        return self._planned(counting)[1].paths if counting else None

    def _initial_rate(self) -> Optional[float]:
        """Rate before an operator has reported; None: unlimited. It is halved where no reports come [byte/s]."""
        limits = self._limits
        if not self._adapt:
            return limits.max_rate if limits.max_rate < math.inf else None
        start = min(limits.start_rate, limits.max_rate)
        waiting = [state.paths.rate for name, state in self._operators.items()
                   if not self._connections or name in self._connections]
        return min(start, max(waiting, default=start))

    def _capacity(self, now: float) -> Optional[float]:
        """Capacity of the link that the streams are planned for; None: unlimited [byte/s]."""
        paths = self._planned_paths(now)
        return paths.capacity if paths else self._initial_rate()

    def gain(self, now: float) -> float:
        """What is sent now may be longer by this factor, as a train leaves."""
        paths = self._planned_paths(now)
        return paths.planned(_budget(paths)) if paths else 1.0

    def _divide(self, capacity: Optional[float], demands: Mapping[str, Demand], protected: float,
                now: float) -> Tuple[Dict[str, float], Dict[str, float], Dict[str, Optional[Dict[str, Any]]]]:
        """(shares, rooms, grants) as in a Plan."""
        if capacity is None:
            return {}, {}, {name: {} for name in demands}
        paths, gain = self._planned_paths(now), self.gain(now)
        budget = (_budget(paths) if paths else PLANNING_SHARE * capacity) * gain
        allocated = self._allocator.allocate(budget, demands, protected, now)
        limited = {name for name, grant in allocated.items()
                   if grant.point is not None and grant.point < len(demands[name].points) - 1}
        spare = max(0.0, budget - protected - math.fsum(grant.cost for grant in allocated.values()))
        weights = math.fsum(demands[name].weight for name in limited)
        grants: Dict[str, Optional[Dict[str, Any]]] = {}
        rooms = {name: spare + grant.cost for name, grant in allocated.items()}
        for name, grant in allocated.items():
            if name in limited:
                part = spare * demands[name].weight / weights if weights else 0.0
                grants[name], rooms[name] = self._limiting_settings(name, grant, demands[name], part), grant.cost + part
            else:
                grants[name] = None if grant.point is None else {}
        return ({name: grant.share for name, grant in allocated.items()},
                {name: room / gain for name, room in rooms.items()}, grants)

    def _divide_slower_links(self, demands: Mapping[str, Demand], protected: float, now: float) -> None:
        """Decide which part of each stream operators with slower links get, by weights and min_bitrates alike."""
        rates = {name: self._stream_sent.setdefault(name, Rate(SENT_WINDOW)) for name in demands}
        self._stream_sent = rates
        for name, rate in rates.items():
            rate.read(self._history.bytes_of(name), now)
        sent = {name: replace(demand, points=[OperatingPoint({}, rates[name].per_second or 0.0)])
                for name, demand in demands.items()}
        for state in self._operators.values():
            granted = divide(max(0.0, state.paths.capacity - protected), sent)
            state.policer.whole = {name for name, demand in demands.items() if demand.whole}
            state.policer.parts = {name: granted[name] / demand.points[0].cost for name, demand in sent.items()
                                   if demand.points[0].cost > granted[name]}

    def _limiting_settings(self, name: str, grant: Grant, demand: Demand, spare: float) -> Dict[str, Any]:
        """An operating point's settings, refined; those granted before where they are nearly the same."""
        before = self._grants.get(name) or {}
        return {setting: _steady(before.get(setting), value)
                for setting, value in demand.refine(grant.settings, spare).items()
                if setting != 'rate' or value < RATE_LIMIT_FACTOR * demand.rate}


def _budget(paths: Bundle) -> float:
    """The part of the capacity that is allocated [byte/s]."""
    return paths.capacity * (REFILL_SHARE if paths.has_deep_bucket else PLANNING_SHARE)


def _steady(before: Any, value: Any) -> Any:
    """The value granted before, if the new one is within GRANT_TOLERANCE of it."""
    numbers = isinstance(before, (int, float)) and isinstance(value, (int, float))
    return before if numbers and math.isclose(before, value, rel_tol=GRANT_TOLERANCE) else value
