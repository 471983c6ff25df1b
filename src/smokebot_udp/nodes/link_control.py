# SPDX-License-Identifier: BSD-3-Clause
"""Runs the robot's link controller: takes operators' reports, sets the outbox's rate and streams' grants, and publishes
~link.
"""
import collections
import dataclasses
import functools
import math
import threading
import time
from typing import Any, Callable, Dict, List, Mapping, Sequence

import rospy

from ..congestion.controller import Controller, Demand, Plan
from ..congestion.estimator import REPORT_INTERVAL
from ..congestion.packet_scheduler import PacketScheduler
from ..monitoring.stats import LinkStats
from ..monitoring.wifi import WifiState
from ..msg import LinkReport, LinkStatus, PathStatus, WifiStatus
from ..paths import STRAIGHT, PathUse, Route
from ..streams.outlook import Outlook, Rooms, StreamLosses
from ..units import MBIT
from .link_reporter import TOPIC, path_of
from .logging import log_error
from .opened import Part
from .outbox import Departed
from .path_monitor import PathMonitor
from .robot_stream import RobotLink, RobotStream
from .wifi_monitor import WifiMonitor
from .worker import PeriodicWorker

UNPACED = 800 * MBIT
"""On a faster link datagrams are not paced. It is no radio, and nothing on the way to it is faster: there is no queue
that they could overrun. A raw image leaves in a quarter of the time [byte/s]."""


MarkPaths = Callable[[Mapping[str, Sequence[PathUse]]], Mapping[str, Sequence[PathUse]]]


class SharedController:
    """A Controller that several threads use, one at a time: ``with shared as controller: ...``.

    Its lock may be taken under the outbox's, and not the other way round.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller, self._lock = controller, threading.Lock()
        self.sent: Departed = lambda *_: None
        """Called with what left, too."""

    def __enter__(self) -> Controller:
        self._lock.acquire()
        return self._controller

    def __exit__(self, *_: Any) -> None:
        self._lock.release()

    def route(self, stream: str, count: int, size: int, now: float, start: int = 0, total: int = 1,
              waiting: float = 0.0, whole: bool = False) -> Route:
        """As Controller.route, for the outbox."""
        with self as controller:
            return controller.route(stream, count, size, now, start, total, waiting, whole)

    def on_sent(self, stream: str, seq: int, count: int, size: int, now: float, route: Route = STRAIGHT) -> None:
        """As Controller.on_sent, for the outbox."""
        with self as controller:
            controller.on_sent(stream, seq, count, size, now, route)
        self.sent(stream, seq, count, size, now, route)

    def on_sent_besides(self, size: int) -> None:
        """As Controller.on_sent_besides, for the outbox."""
        with self as controller:
            controller.on_sent_besides(size)


class LinkControl(Part):
    """Runs a controller; lives as long as its node. The outbox keeps its last rate then.

    :param controller: that the outbox reports to
    :param link: of the streams; its datagram_size follows the plan
    :param streams: {name: RobotStream}, started
    :param reported: f(operator, seq), called with whose report came, and its sequence number
    :param wifi_interface: the parameter ~wifi_interface
    :param mark: f(paths of operators) -> the same, with the policies of the robot
    :param further: f(capacity) -> {name: Demand}, of what is sent beside the streams. The capacity is that of the link,
        or while that is unknown the rate; 0: unknown and unlimited [byte/s]
    """

    def __init__(self, controller: SharedController, link: RobotLink, streams: Mapping[str, RobotStream],
                 reported: Callable[[str, int], None] = lambda operator, seq: None, wifi_interface: str = '',
                 mark: MarkPaths = lambda paths: paths,
                 further: Callable[[float], Mapping[str, Demand]] = lambda capacity: {}) -> None:
        super().__init__()
        self._controller, self._link, self._streams, self._reported = controller, link, streams, reported
        self._further, self._mark, self._capacity = further, mark, 0.0
        self._losses, self._rooms = StreamLosses(), Rooms()
        opened = self._opened
        self._status = opened.topic(rospy.Publisher('~link', LinkStatus, queue_size=1))
        self._paths = opened.add(PathMonitor(link.transport, link.outbox))
        controller.sent = self._paths.sent
        with controller as unshared:
            unshared.on_arrivals = self._losses.add
        self.shares: Dict[str, float] = {}
        """{stream: its share of the link [byte/s]}; empty: unlimited."""
        self._reports = opened.topic(link.transport.subscriber(TOPIC, LinkReport, self._on_report, queue_size=10))
        self.wifi = opened.started(WifiMonitor(self._hosts, wifi_interface))
        self._ticks = opened.started(PeriodicWorker('link', self._tick, log_error('link'), REPORT_INTERVAL))
        link.subscribed, link.transport.on_moved = self._count_operators, self._ticks.wake

    def forget(self) -> None:
        """The mission focus changed: the next tick divides the link without hysteresis."""
        with self._controller as controller:
            controller.forget()

    def stats(self, now: float) -> LinkStats:
        """The link as it is now, by time.monotonic()."""
        with self._controller as controller:
            stats = controller.stats(now)
        return dataclasses.replace(stats, longest=self._paths.hole)

    def _on_report(self, report: Any) -> None:
        """Take a report; the transport's thread."""
        now, path = time.monotonic(), path_of(report)
        with self._controller as controller:
            header = report._connection_header      # one object for each connection
            train = controller.on_report(header['callerid'], report, now, id(header), path)
        self._paths.reported(header['callerid'], report, now, path)
        self._reported(header['callerid'], report.header.seq)

        def follow(scheduler: PacketScheduler) -> None:
            self._set_rate(scheduler, now)
            if train is not None:
                scheduler.start_probe(train.rate, train.size)
        self._link.outbox.change(follow)
        if train is not None and self._gain() > 1:
            self._ticks.wake()      # streams are planned for it

    def _tick(self) -> None:
        now = time.monotonic()
        demands = {**{name: stream.demand(now) for name, stream in self._streams.items()},
                   **self._further(self._capacity)}
        self._count_operators()
        self._paths.tick(now)
        paths = self._mark(self._link.transport.paths(now))
        with self._controller as controller:
            fell = controller.on_paths(paths, now)
            if fell:
                self._rooms = Rooms()   # the plan is followed at once
            plan = controller.tick(now, {name: demand for name, demand in demands.items() if demand is not None},
                                   self._link.outbox.protected)
            stats = dataclasses.replace(controller.stats(now), longest=self._paths.hole)
            self._capacity = stats.capacity if math.isfinite(stats.capacity) else plan.rate or 0.0
            self._give_outlooks(plan, stats.loss, now)
        self._link.datagram_size, self.shares = min(plan.datagram_size, self._link.transport.room), plan.shares
        grant(plan, self._streams, self._capacity)
        self._link.follow(plan.rate, stats.sent)
        if fell:
            for stream in self._streams.values():
                stream.drop_rest()

        def follow(scheduler: PacketScheduler) -> None:
            self._set_rate(scheduler, now)
            for name, share in plan.shares.items():
                scheduler.set_share(name, share)
        self._link.outbox.change(follow)
        status = as_message(stats, self.wifi.state)
        status.header.stamp = rospy.Time.now()
        self._status.publish(status)

    def _give_outlooks(self, plan: Plan, loss: float, now: float) -> None:
        """Pass on to the streams what to expect of the link, under the controller's lock: reports change it."""
        rooms = self._rooms.update(plan.rooms)

        def outlook(name: str) -> Outlook:
            return Outlook(self._losses.air(name, self._streams[name].subscribers, now),
                           rooms.get(name, math.inf) / self._link.expansion, self._gain, self._tokens)
        for name, stream in self._streams.items():
            stream.follow(loss, functools.partial(outlook, name))

    def _gain(self) -> float:
        """As Outlook.gain; any thread."""
        with self._controller as controller:
            return controller.gain(time.monotonic())

    def _tokens(self) -> float:
        """As Outlook.tokens; any thread."""
        with self._controller as controller:
            depth, missing = controller.tokens(time.monotonic())
        return max(0.0, depth - missing) / self._link.expansion

    def _count_operators(self) -> None:
        """Pass on who subscribes to the streams now; any thread."""
        connections = collections.Counter(name for stream in self._streams.values() for name in stream.subscribers)
        with self._controller as controller:
            controller.on_operators(connections, time.monotonic())

    def _set_rate(self, scheduler: PacketScheduler, now: float) -> None:
        """Set the present rate, under the outbox's lock: a report may have changed it since the plan was made."""
        with self._controller as controller:
            rate, tokens = controller.rate(now), controller.tokens(now)
        scheduler.set_rate(None if rate is not None and rate > UNPACED else rate, now)
        scheduler.set_tokens(*tokens, now)

    def _hosts(self) -> List[str]:
        """The hosts of the operators that report."""
        return [connection['address'][0] for connection in self._reports.connections()]


def grant(plan: Plan, streams: Mapping[str, RobotStream], capacity: float = 0.0) -> None:
    """Apply the grants of a plan to the streams; those without a demand are not limited.

    :param capacity: of the link; 0: unknown and unlimited [byte/s]
    """
    for name, stream in streams.items():
        stream.settings.grant(stream.limits(plan.grants.get(name, {}), plan.decimation, capacity))


def as_message(stats: LinkStats, wifi: WifiState) -> LinkStatus:
    """The LinkStatus of a link's stats, without a stamp."""
    return LinkStatus(
        state=stats.state, rate=(stats.rate or 0.0) / MBIT, sent=stats.sent / MBIT, wanted=stats.wanted / MBIT,
        capacity=stats.capacity / MBIT, loss=stats.loss, queue_delay=stats.queue_delay, round_trip=stats.round_trip,
        longest_datagram=stats.longest or 0,
        paths=[PathStatus(path.name, path.sent / MBIT, path.capacity / MBIT, path.loss, path.queue_delay)
               for path in stats.paths],
        wifi=WifiStatus(**dataclasses.asdict(wifi)))
