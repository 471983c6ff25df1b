# SPDX-License-Identifier: BSD-3-Clause
"""Links on which congestion control is hard, each with its goals; supervisor_simulation runs them."""
import random
from dataclasses import replace
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from evaluation.simulated_air import Events, Greedy, Load, Robot
from evaluation.simulated_paths import AggregatingAir, Path
from evaluation.simulated_tcp import Bbr, CongestionControl, Cubic, Tcp
from smokebot_udp.congestion.controller import Demand
from smokebot_udp.congestion.operating_points import OperatingPoint
from smokebot_udp.link_lab.channel import Channel, LinkConditions
from smokebot_udp.units import MBIT

from ..goals import Goal, lost, queue, share, used

DELAY = 0.02
"""One way [s]."""

Values = Dict[str, float]
"""{quantity: value}: of a scenario with one seed"""


class Scenario(NamedTuple):
    """A link, what happens on it, and what has to be reached."""
    name: str
    run: Callable[[int], Values]
    """f(seed) -> {quantity: value}"""
    goals: Sequence[Goal]


def settled(at_most: float) -> Goal:
    """How long less than 80 % of the link is used, or known, in all [s]."""
    return Goal('below 80 % [s]', at_most)


def fairness(at_least: float) -> Goal:
    """Jain's index of what each robot got."""
    return Goal("Jain's index", at_least, True)


def reports(seed: int, loss: float = 0.0, delay: float = DELAY) -> Channel:
    """The way back."""
    return Channel(LinkConditions(loss=loss, delay=delay), seed + 1000)


def over(path: Path, rate: float, seed: int, since: float = 5.0, until: float = 25.0,
         back: Optional[Channel] = None) -> Values:
    """A robot that always has more, alone on a path that carries `rate` Mbit/s."""
    events = Events()
    robot = Robot(events, path, back or reports(seed), Greedy(), seed)
    events.run(since)
    before = replace(path.counts)
    events.run(until)
    counts, waits = path.counts, [wait for when, _, wait in robot.sent if when >= since]
    offered, dropped = counts.offered - before.offered, counts.dropped - before.dropped
    return {'used [%]': (counts.carried - before.carried) * 8e-4 / (until - since) / rate,
            'own loss [%]': 100 * dropped / offered, 'queue p95 [ms]': 1e3 * float(np.percentile(waits, 95))}


def link(rate: float, since: float = 5.0, **conditions: float) -> Callable[[int], Values]:
    """A link_lab Channel of `rate` Mbit/s."""
    chosen = LinkConditions(**{'rate': rate * 1e6, 'delay': DELAY, 'queue': 0.2, **conditions})
    return lambda seed: over(Channel(chosen, seed), rate, seed, since)


def aggregated(rate: float) -> Callable[[int], Values]:
    """Wi-Fi that sends in aggregates, `rate` Mbit/s in all."""
    return lambda seed: over(AggregatingAir(rate * 1e6, DELAY, 0.2, seed), rate, seed)


def asymmetric(seed: int) -> Values:
    """20 Mbit/s there; back 0.1 Mbit/s with 150 ms of delay, 30 ms of jitter and 10 % loss."""
    back = Channel(LinkConditions(rate=0.1e6, delay=0.15, jitter=0.03, loss=0.1, queue=0.5), seed + 1000)
    return over(Channel(LinkConditions(rate=20e6, delay=DELAY, queue=0.2), seed), 20, seed, back=back)


def varying(seed: int, every: float = 1.0, until: float = 40.0) -> Values:
    """Another rate each second, of 1 to 20 Mbit/s."""
    draw, events = random.Random('%s rates' % seed), Events()
    there = Channel(LinkConditions(rate=5e6, delay=DELAY, queue=0.2), seed)
    robot = Robot(events, there, reports(seed), Greedy(), seed)
    events.run(5)
    before, carried = replace(there.counts), 0.0
    for second in range(5, int(until)):
        rate = draw.choice([1.0, 2.0, 5.0, 10.0, 20.0])
        there.conditions = replace(there.conditions, rate=rate * 1e6)
        carried += rate
        events.run(second + every)
    waits = [wait for when, _, wait in robot.sent if when >= 5]
    return {'used [%]': (there.counts.carried - before.carried) * 8e-4 / carried,
            'own loss [%]': 100 * (there.counts.dropped - before.dropped) / (there.counts.offered - before.offered),
            'queue p95 [ms]': 1e3 * float(np.percentile(waits, 95))}


def below(robot: Robot, rate: float, since: float, part: float = 0.8, window: float = 0.5) -> float:
    """How long in all, from `since` on, less than `part` of `rate` Mbit/s is sent over a window [s]."""
    edges = np.arange(since, robot.events.now, 0.05)
    sent = np.array([(when, size) for when, size, _ in robot.sent if when >= since])
    each = np.histogram(sent[:, 0], edges, weights=sent[:, 1])[0]
    slots = round(window / 0.05)
    recent = np.convolve(each, np.ones(slots))[:len(each)] * 8e-6 / (0.05 * np.minimum(np.arange(len(each)) + 1, slots))
    return float(0.05 * (recent < part * rate).sum())


def changed(before: Dict[str, float], after: Dict[str, float], back_too: bool = False) -> Callable[[int], Values]:
    """A link whose conditions change at 10 s."""
    def run(seed: int) -> Values:
        events = Events()
        common = {'delay': DELAY, 'queue': 0.2}
        there = Channel(LinkConditions(**{**common, **before}), seed)
        robot = Robot(events, there, reports(seed), Greedy(), seed)
        events.run(10)
        there.conditions = replace(there.conditions, **after)
        if back_too:
            robot.back.conditions = replace(robot.back.conditions, loss=after['loss'])
        events.run(25)
        return {'below 80 % [s]': below(robot, there.conditions.rate / 1e6, 10.0)}
    return run


class Partial(Load):
    """Streams that want more than they send, as one that stands still or compresses well does. First they are greedy.

    :param until: when they begin to send less [s]
    :param rate: what they send then [Mbit/s]
    """
    DEMAND = Demand([OperatingPoint({}, 1.0), OperatingPoint({}, 1e9)])
    FRAMES, SIZE = 10.0, 1000

    def __init__(self, until: float, rate: float) -> None:
        self._until, self._size = until, rate * MBIT / self.FRAMES
        self._greedy = Greedy()

    def start(self, robot: Robot) -> None:
        self._send(robot)

    def demands(self) -> Dict[str, Demand]:
        return {'partial': self.DEMAND}

    def _send(self, robot: Robot) -> None:
        rate = robot.controller.rate(robot.robot_time) or 0.0
        size = rate * 1.2 / self.FRAMES if robot.events.now < self._until else self._size
        robot.put('partial', None, [(max(1, round(size / self.SIZE)), self.SIZE)])
        robot.events.at(robot.events.now + 1 / self.FRAMES, self._send, robot)


def sudden_loss_beside_little(loss: float) -> Callable[[int], Values]:
    """1 Mbit/s, of which streams use 0.16; at 15 s datagrams and reports begin to be lost."""
    def run(seed: int) -> Values:
        events = Events()
        there = Channel(LinkConditions(rate=1e6, delay=DELAY, queue=0.2), seed)
        robot = Robot(events, there, reports(seed), Partial(10.0, 0.16), seed)
        events.run(15)
        for channel in (there, robot.back):
            channel.conditions = replace(channel.conditions, loss=loss)
        known = []
        while events.now < 40:
            events.run(events.now + 0.1)
            known.append(robot.controller.stats(robot.robot_time).capacity / MBIT)
        return {'below 80 % [s]': 0.1 * sum(one < 0.8 for one in known), 'least known [Mbit/s]': min(known),
                'most known [Mbit/s]': max(known)}
    return run


def idle_stream(seed: int) -> Values:
    """20 Mbit/s; for 20 s there is only a small protected stream, then one that always has more."""
    events = Events()
    there = Channel(LinkConditions(rate=20e6, delay=DELAY, queue=0.2), seed)
    robot = Robot(events, there, reports(seed), Greedy(20.0), seed)

    def publish() -> None:
        robot.publish('tf', None, 300)
        events.at(events.now + 0.05, publish)
    publish()
    events.run(35)
    return {'below 80 % [s]': below(robot, 20, 20.0)}


def crowd(robots: int) -> Callable[[int], Values]:
    """Robots that share an air of 20 Mbit/s and begin within 5 s; measured from 20 to 40 s, fairness over 10 s each."""
    def run(seed: int) -> Values:
        events, draw = Events(), random.Random('%s starts' % seed)
        air = Channel(LinkConditions(rate=20e6, delay=DELAY, queue=0.2), seed)
        all_ = [Robot(events, air, reports(seed + number), Greedy(draw.uniform(0, 5)), 1000 * seed + number)
                for number in range(robots)]
        events.run(40)
        jain, sizes = [], []
        for since in (20, 30):
            got = np.array([sum(size for when, size, _ in robot.sent if since <= when < since + 10)
                            for robot in all_])
            jain.append(got.sum() ** 2 / (robots * (got ** 2).sum()))
            sizes.append(got.sum())
        waits = [wait for robot in all_ for when, _, wait in robot.sent if when >= 20]
        return {'used [%]': sum(sizes) * 8e-4 / 20 / 20, "Jain's index": float(min(jain)),
                'queue p95 [ms]': 1e3 * float(np.percentile(waits, 95)),
                'own loss [%]': 100 * float(np.mean(np.array(waits) > 0.2))}
    return run


def beside_tcp(control: Callable[[], CongestionControl], rate: float, length: float) -> Callable[[int], Values]:
    """A TCP download that begins 5 s after us on `rate` Mbit/s with a queue of `length` s; measured from 15 to 45 s."""
    def run(seed: int) -> Values:
        events, since, until = Events(), 15, 45
        there = Channel(LinkConditions(rate=rate * 1e6, delay=DELAY, queue=length), seed)
        robot = Robot(events, there, reports(seed), Greedy(), seed)
        tcp = Tcp(events, there, DELAY, control(), 5.0 + 0.1 * seed)
        events.run(until)
        came = [(when, 1500.0) for when, *_ in robot.came]
        ours = rates_of(came, since, until)
        theirs = rates_of(tcp.came, since, until)
        both = ours + theirs
        return {'used [%]': 100 * float(both.mean()) / rate, 'share [%]': 100 * float(ours.sum() / both.sum()),
                'least in 5 s [%]': 100 * float((ours / rate).min()),
                'least theirs [%]': 100 * float((theirs / rate).min())}
    return run


def rates_of(came: Sequence[Tuple[float, float]], since: float, until: float, window: float = 5.0) -> Any:
    """Mbit/s over each window: ndarray of float64"""
    rows: Any = np.array(came)
    edges = np.arange(since, until + window / 2, window)
    return np.histogram(rows[:, 0], edges, weights=rows[:, 1])[0] * 8e-6 / window


SCENARIOS: List[Scenario] = [
    *[Scenario('jitter of 10 ms, %g Mbit/s' % rate, link(rate, jitter=0.01), [used(85), lost(1), queue(60)])
      for rate in (1, 5, 20)],
    *[Scenario('queue of 10 ms, %g Mbit/s' % rate, link(rate, queue=0.01), [used(85), lost(1)]) for rate in (5, 20)],
    *[Scenario('policer, %g Mbit/s, %g kB' % (rate, bucket / 1e3), link(rate, bucket=bucket), [used(85), lost(1)])
      for rate, bucket in ((5, 15e3), (5, 60e3), (20, 30e3))],
    *[Scenario('bursts of loss, %g %%, 5 Mbit/s' % (100 * loss), link(5, loss=loss, burst=burst),
               [used(85), lost(1), queue(60)])
      for loss, burst in ((0.1, 5.0), (0.2, 10.0))],
    Scenario('0.3 to 20 Mbit/s', changed({'rate': 0.3e6}, {'rate': 20e6}), [settled(3)]),
    Scenario('90 % loss at once', changed({'rate': 5e6}, {'loss': 0.9}, True), [settled(5)]),
    Scenario('50 % loss, streams send little', sudden_loss_beside_little(0.5), [settled(5)]),
    Scenario('20 % loss, streams send little', sudden_loss_beside_little(0.2), [settled(5)]),
    Scenario('an idle stream begins', idle_stream, [settled(3)]),
    Scenario('another rate each second', varying, [used(85), lost(1), queue(60)]),
    *[Scenario('aggregates, %g Mbit/s' % rate, aggregated(rate), [used(85), lost(1), queue(60)]) for rate in (5, 20)],
    Scenario('asymmetric path', asymmetric, [used(85), lost(1), queue(60)]),
    *[Scenario('%d robots, one air' % robots, crowd(robots), [used(85), fairness(0.95), queue(60)])
      for robots in (2, 4, 10)],
    *[Scenario('beside TCP %s, queue of %d ms' % (kind.__name__.lower(), 1e3 * length), beside_tcp(kind, 10, length),
               share(30, 70)) for kind in (Cubic, Bbr) for length in (0.05, 0.2)],
]
