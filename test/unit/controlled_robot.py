# SPDX-License-Identifier: BSD-3-Clause
"""A robot whose rate a link controller decides, and its operators: what the controller's tests share."""
import collections
import itertools
from typing import Any, Deque, Dict, Iterable, List, Mapping, Optional, Tuple

from smokebot_udp.congestion.controller import Controller, Demand, Plan
from smokebot_udp.congestion.estimator import Limits
from smokebot_udp.congestion.feedback import ReceiveHistory, Report
from smokebot_udp.congestion.operating_points import image_points
from smokebot_udp.congestion.trains import Train
from smokebot_udp.monitoring.stats import LinkStats
from smokebot_udp.units import MBIT

LIMITS = Limits(min_rate=0.1 * MBIT, start_rate=0.5 * MBIT, max_rate=10 * MBIT)
SIZE = 1500     # of a datagram on the air


def image(rate: float = 10.0, **options: Any) -> Demand:
    """The demand of images of 64 datagrams, ten a second: 640 datagrams a second."""
    def refine(settings: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        count = (settings['max_subimages'] or 64) + int(spare / (settings['rate'] * SIZE))
        return {**settings, 'max_subimages': 0 if count >= 64 else count}
    return Demand(image_points(rate, 64, 1, SIZE), rate=rate, refine=refine, **options)


def taken(grant: Optional[Dict[str, Any]], rate: float = 10.0) -> float:
    """What images take of the link as they are granted [byte/s]."""
    if grant is None:
        return 0.0
    settings = {'rate': rate, 'max_subimages': 0, **grant}
    return settings['rate'] * (settings['max_subimages'] or 64) * SIZE


class Receiver:
    """An operator at the end of a link of `rate` [byte/s] and 20 ms; both may change."""

    def __init__(self, name: str, rate: float) -> None:
        self.name, self.rate, self.delay = name, rate, 0.02
        self._history, self._free = ReceiveHistory(lambda: 7), 0.0
        self._arriving: Deque[Tuple[float, int]] = collections.deque()
        self.received = 0

    def receive(self, seq: int, now: float) -> None:
        self.received += 1
        self._free = max(self._free, now) + SIZE / self.rate
        self._arriving.append((self._free + self.delay, seq))

    def report(self, now: float) -> Report:
        while self._arriving and self._arriving[0][0] <= now:
            arrived, seq = self._arriving.popleft()
            self._history.add('thermal', seq, SIZE, arrived)
        return self._history.report(now)


class Robot:
    """Sends datagrams as fast as a controller allows; time passes as they leave."""

    def __init__(self, limits: Limits = LIMITS, adapt: bool = True) -> None:
        self.controller, self.now = Controller(limits, adapt, 1472), 1000.0
        self.demands = {'thermal': image(rate=30.0)}
        self.plans: List[Plan] = []
        self.trains: List[Train] = []
        self._seq = itertools.count(1)

    @property
    def rate(self) -> float:
        rate = self.controller.rate(self.now)
        assert rate is not None
        return rate

    @property
    def state(self) -> LinkStats:
        return self.controller.stats(self.now)

    def tick(self) -> Plan:
        self.plans.append(self.controller.tick(self.now, self.demands, 0))
        return self.plans[-1]

    def drive(self, receivers: Iterable[Receiver], seconds: float) -> None:
        """All receivers get each datagram that conforms, and report ten times a second."""
        until, next_report, receivers = self.now + seconds, self.now + 0.1, list(receivers)
        while self.now < until:
            seq = next(self._seq)
            route = self.controller.route('thermal', 1, SIZE, self.now)
            self.controller.on_sent('thermal', seq, 1, SIZE, self.now, route)
            for receiver in receivers:
                if route.limits.get(receiver.name, 1):
                    receiver.receive(seq, self.now)
            self.now += SIZE / self.rate
            if self.now >= next_report:
                next_report += 0.1
                for receiver in receivers:
                    train = self.controller.on_report(receiver.name, receiver.report(self.now), self.now, 1)
                    self.trains += [train] if train else []
                self.tick()


def settled(capacity: float, demands: Mapping[str, Demand], controller: Optional[Controller] = None,
            protected: float = 0.0) -> Plan:
    """The plan on a link of fixed capacity after upgrades had their time [byte/s]."""
    controller = controller or Controller(Limits(max_rate=capacity), False, 1472)
    for step in range(50):
        plan = controller.tick(0.1 * step, demands, round(0.1 * step * protected))
    return plan
