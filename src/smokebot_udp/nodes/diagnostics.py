# SPDX-License-Identifier: BSD-3-Clause
"""Publishes /diagnostics once a second, on either side: a status for each stream, each connection and the link.

Parameters: the warning thresholds, DIAGNOSTICS in nodes/parameters.py, listed in doc/parameters.md. They are read when
the node starts; each can also be set for one stream, as ~<stream>/warn_loss.

Latched streams and carousels may be silent and old: only their connections and their loss are judged.

What the statuses mean is decided in monitoring/, from the stats of streams, connections and the link
(monitoring/stats.py); here they are rendered.
"""
import dataclasses
import functools
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence

import diagnostic_updater
import rosgraph
import rospy

from .. import udpros
from ..monitoring.computer import ComputerMonitor
from ..monitoring.node_status import RequestMonitor, clock_status, link_status, transport_status
from ..monitoring.sources import LISTENER, TOPIC, SourceWatch, graph_of
from ..monitoring.stats import PAUSED, StreamStats
from ..monitoring.status import ERROR, OPERATOR, ROBOT, Kind, Status
from ..monitoring.stream_status import StreamMonitor
from ..monitoring.thresholds import Thresholds
from ..monitoring.wifi import WifiState, wifi_status
from ..transport import Transport
from ..udpros import rpc
from .logging import log_error
from .machine_load import present_load
from .status_listener import StatusListener
from .status_messages import as_message
from .stream_problems import StreamProblems
from .way_back import WayBack
from .worker import PeriodicWorker

PERIOD = 1.0
"""[s]"""

Statuses = Callable[[float], List[Status]]
"""f(time [s]) -> statuses"""


def read_thresholds(names: Iterable[str], parameters: Any) -> Dict[str, Thresholds]:
    """{stream: its thresholds} from the node's common.Parameters; invalid values are reported."""
    common, problems = Thresholds().override(parameters.values)
    thresholds = {}
    for name in names:
        own = parameters.values.get(name)
        thresholds[name], own_problems = common.override(own if isinstance(own, dict) else {})
        problems += ['%s/%s' % (name, problem) for problem in own_problems]
    for problem in problems:
        parameters.report('~%s' % problem)
    return thresholds


class Diagnostics:
    """Publishes statuses from its own thread: a simulated clock that stops must not stop it.

    :param side: ROBOT or OPERATOR
    :param sources: if one fails the others are still published
    :param watch: what they ask the master for
    """

    def __init__(self, side: str, sources: Sequence[Statuses], watch: 'MasterWatch') -> None:
        self._side, self._sources, self._watch, self._log_error = side, sources, watch, log_error('diagnostics')
        # only the Updater's publish: its list of tasks is fixed, but connections come and go
        self._updater = diagnostic_updater.Updater()
        self._worker = PeriodicWorker('diagnostics', self._publish, self._log_error, PERIOD)
        self._worker.start()

    def _publish(self) -> None:
        messages, now = [], time.monotonic()
        for source in self._sources:
            try:
                messages += [as_message(status, self._side) for status in source(now)]
            except Exception as error:
                self._log_error(error)
        if not rospy.is_shutdown():
            self._updater.publish(messages)

    def close(self) -> None:
        self._worker.close()
        self._watch.close()


class MasterWatch(SourceWatch):
    """Asks the master from its own thread: over a link that is cut it takes seconds to find that it does not answer."""

    def __init__(self) -> None:
        self._worker = PeriodicWorker('sources', self._update, log_error('the sources of streams'), None)
        super().__init__(self._worker.wake, time.monotonic())
        self._worker.start()

    def _update(self) -> None:
        try:
            master = rosgraph.get_master_uri()
            self.answer(graph_of(rpc.call(master, 'getSystemState'), rpc.call(master, 'getTopicTypes')))
        except (rpc.Unreachable, rpc.Refused):
            self.answer(None)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()


def robot_diagnostics(streams: Mapping[str, Any], way_back: WayBack, link: Any, parameters: Any, problems: Any,
                      transport: Transport, found: StreamProblems) -> Diagnostics:
    """Start the diagnostics of the robot's side.

    :param streams: {name: RobotStream}, started
    :param way_back: started
    :param link: link_control.LinkControl
    :param parameters: common.Parameters
    :param problems: problems.Problems
    :param found: gets what is wrong with the sources of streams
    :return: to be closed before the streams and the transport
    """
    watch, of_node = MasterWatch(), _of_node(way_back, parameters, problems, transport)

    def update(stream: Any, monitor: StreamMonitor, now: float) -> List[Status]:
        stats: StreamStats = stream.stats()
        problem = _source_problem(stream, stats, monitor, watch, now)
        found.note(stream.name, problem, stats.problem if stats.problem != PAUSED else None)
        return monitor.update(dataclasses.replace(stats, problem=stats.problem or problem), now)

    def update_node(now: float) -> List[Status]:
        return [link_status(link.stats(now)), wifi_status(link.wifi.state), *of_node(now)]
    return Diagnostics(ROBOT, _sources(ROBOT, {**streams, **way_back.streams}, parameters, update) + [update_node],
                       watch)


def operator_diagnostics(streams: Mapping[str, Any], way_back: WayBack, clock: Any, parameters: Any, problems: Any,
                         robot: StatusListener, transport: Transport,
                         wifi: Callable[[], WifiState]) -> Diagnostics:
    """Start the diagnostics of the operator's side.

    :param streams: {name: OperatorStream}, started
    :param way_back: started
    :param clock: clock_sync.ClockClient
    :param parameters: common.Parameters
    :param problems: problems.Problems
    :param robot: the robot's last report of what it sends
    :param wifi: f() -> the state of this machine's Wi-Fi
    :return: to be closed before the streams, the clock and the transport
    """
    watch, of_node = MasterWatch(), _of_node(way_back, parameters, problems, transport)

    def update(stream: Any, monitor: StreamMonitor, now: float) -> List[Status]:
        stats, sent, estimate = stream.stats(), robot.sent().get(stream.name), clock.estimate
        if sent is not None:
            stats = dataclasses.replace(stats, enabled=sent.enabled, rate=sent.rate)
        refused = robot.problems().get(stream.name)
        if refused and not stats.connections:
            stats = dataclasses.replace(stats, problem='the robot: ' + refused)
        return monitor.update(stats, now, estimate.offset if estimate else None)

    def update_back(stream: Any, monitor: StreamMonitor, now: float) -> List[Status]:
        stats: StreamStats = stream.stats()
        problem = _source_problem(stream, stats, monitor, watch, now, False)
        return monitor.update(dataclasses.replace(stats, problem=stats.problem or problem), now)

    def update_node(now: float) -> List[Status]:
        return [clock_status(clock.estimate, clock.counts), wifi_status(wifi()), *of_node(now)]
    return Diagnostics(OPERATOR, _sources(OPERATOR, streams, parameters, update)
                       + _sources(OPERATOR, way_back.streams, parameters, update_back) + [update_node], watch)


def _of_node(way_back: WayBack, parameters: Any, problems: Any, transport: Transport) -> Statuses:
    """The statuses that a node has on either side, besides those of streams."""
    requests, computer = RequestMonitor(), ComputerMonitor()

    def update(now: float) -> List[Status]:
        refused, stats = parameters.refused, transport.stats(now)
        statuses = [*way_back.statuses(now), problems.status(now), requests.update(udpros.refused_requests(), now),
                    computer.update(present_load(), now)]
        if refused:
            reasons = '; '.join('%s: %s' % item for item in refused.items())
            statuses.append(Status(Kind.REFUSED, 'refused streams', ERROR, reasons, {
                'refused': len(refused), **refused}))
        return statuses + ([] if stats is None else [transport_status(stats)])
    return update


def _source_problem(stream: Any, stats: StreamStats, monitor: StreamMonitor, watch: SourceWatch, now: float,
                    must_exist: bool = True) -> Optional[str]:
    """What is wrong with the source of a stream; None: nothing is known.

    :param must_exist: whether a source that is missing is a problem, or only one of another type
    """
    source = stream.source
    if source is None or not stats.enabled:
        return None
    if source.kind == LISTENER and stream.heard:
        return None
    if source.kind != TOPIC:
        return watch.problem(source, now)
    if not monitor.waits_for_source(stats, now):
        return None
    problem = watch.problem(source, now, stats.steady)
    return problem if must_exist or ' must be ' in (problem or '') else None


def _sources(side: str, streams: Mapping[str, Any], parameters: Any,
             update: Callable[[Any, StreamMonitor, float], List[Status]]) -> List[Statuses]:
    """A source of statuses for each stream."""
    thresholds, now = read_thresholds(streams, parameters), time.monotonic()
    return [functools.partial(update, stream, StreamMonitor(side, name, stream.topic, thresholds[name], now))
            for name, stream in streams.items()]
