# SPDX-License-Identifier: BSD-3-Clause
"""Tells /diagnostics once a second how the link is, on either side: a status for each stream, and each connection.

Parameters of the node that hosts the streams; each may be given for one stream, too, as ~<stream>/warn_loss.

| name | type | default | unit | meaning |
|---|---|---|---|---|
| ~warn_loss | double | 0.3 | | WARN from this share of the datagrams lost on |
| ~error_loss | double | 0.7 | | ERROR from this share of the datagrams lost on |
| ~warn_completeness | double | 0.5 | | WARN where half of the last messages are less complete |
| ~warn_age | double | 0.5 | s | WARN where half of the last messages are older when they are shown |
| ~error_age | double | 2 | s | ERROR where half of the last messages are older when they are shown |
| ~error_silence | double | 2 | s | ERROR where nothing came for so long, and for three times what is usual |

What is latched or comes in rounds may be silent, and old: it is judged by its connection and its loss.

A stream tells of itself in `figures()`, a dict; what a side does not know is left out:

* in, out: how many messages came and left: of the source and onto the link, or off the link and shown
* enabled, rate: whether it is sent, and at most how often [Hz]
* steady: False where silence is no fault
* dropped: {reason: count}, what came to nothing
* shown: [(age [s] by this machine's clock, completeness 0..1), ...] since the last call, None for what is unknown
* connections: as of udpros.Publisher or udpros.Subscriber
* problem: in words, what else is worth a WARN now

All counts only grow.
"""
import functools
import socket
import time
from typing import Any, Dict, NamedTuple

import diagnostic_updater
import rospy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from ..monitoring.windows import ERROR, OK, WARN, Limits, Rates, Samples, Silence, Verdict, share
from ..streams.rate import Repeater

ROBOT, OPERATOR = 'robot', 'operator'
PERIOD = 1.0
"""[s]"""

ENOUGH = 20
"""Of fewer messages in the window a share that was lost says little, and is not judged."""


def read_limits(names, parameters):
    """{stream: Limits} from the node's common.Parameters; what is wrong is told of."""
    tree = parameters.values
    common, problems = Limits().changed(tree)
    limits = {}
    for name in names:
        part = tree.get(name)
        limits[name], wrong = common.changed(part if isinstance(part, dict) else {})
        problems += ['%s/%s' % (name, problem) for problem in wrong]
    for problem in problems:
        parameters.tell('~%s' % problem)
    return limits


class Status(NamedTuple):
    """What a DiagnosticStatus says."""
    name: str
    level: int
    message: str
    values: Dict[str, Any]
    """In order; what is None is not known, and not told."""


class ConnectionWatch:
    """One UDPROS connection over time."""

    def __init__(self):
        self._rates = Rates('bytes', 'datagrams', 'received', 'expected', 'kernel_drops', 'failed')
        self.growth, self.per_second = self._rates.growth, self._rates.per_second

    def read(self, connection, now):
        """:param connection: one of udpros.Publisher.connections() or Subscriber.connections()"""
        readings = {**connection, 'failed': sum(connection.get('failures', {}).values())}
        if connection.get('received') is not None:
            # lost ones that come late are lost no longer: of the counts only this sum never falls
            readings['expected'] = connection['received'] + connection['lost']
        self._rates.read(readings, now)

    def status(self, name, side, connection, limits):
        verdict = Verdict()
        loss = judge_connections(verdict, [self], limits)
        return Status('%s, %s' % (name, connection['peer']), verdict.level, str(verdict) or 'connected', {
            'side': side, 'stream': name, 'peer': connection['peer'],
            'address': '%s:%s' % tuple(connection['address'][:2]), 'datagrams': connection['datagrams'],
            'datagrams/s': self.per_second('datagrams'), 'bytes/s': self.per_second('bytes'),
            'lost': connection.get('lost'), 'loss [%]': _times(100, loss), 'idle [s]': connection.get('idle'),
            'kernel drops': connection.get('kernel_drops'), 'receive buffer [byte]': connection.get('receive_buffer'),
            'longest datagram [byte]': connection.get('max_datagram_size'),
            **_by_reason('dropped', connection.get('dropped')), **_by_reason('not sent', connection.get('failures'))})


def judge_connections(verdict, watches, limits):
    """Judge ConnectionWatches together; returns the share of their messages that were lost, None where none came."""
    expected, received = (sum(watch.growth(name) for watch in watches) for name in ('expected', 'received'))
    loss = share(max(0, expected - received), expected)
    verdict.at_least(loss if expected >= ENOUGH else None, limits.warn_loss, limits.error_loss, '%.0f %% lost', 100)
    for problem, name in (('dropped by the kernel', 'kernel_drops'), ('not sent', 'failed')):
        count = sum(watch.growth(name) for watch in watches)
        if count:
            verdict.find(WARN, '%d datagrams %s' % (count, problem))
    return loss


class StreamWatch:
    """One stream over time.

    :param side: 'robot' or 'operator'
    :param stream: see this file's head
    :param limits: Limits
    :param now: [s] of a steady clock, as always here
    """

    def __init__(self, side, stream, limits, now):
        self.side, self.stream, self.limits = side, stream, limits
        self._rates = Rates('in', 'out')
        self._silences = {'in': Silence(now), 'out': Silence(now)}
        self._ages, self._completeness = Samples(), Samples()
        self._connections = {}  # {(peer, address): ConnectionWatch}

    def look(self, now, offset=0.0, told=None):
        """The statuses of the stream and of its connections, in this order.

        :param offset: the clock that stamps are of minus this machine's; None: unknown, and so are ages [s]
        :param told: figures that the other side told, which count where the stream does not know them
        """
        figures = {'enabled': True, 'rate': 0.0, 'steady': True, 'connections': [], **(told or {}),
                   **self.stream.figures()}
        self._rates.read(figures, now)
        for way, silence in self._silences.items():
            silence.read(figures.get(way), now)
        for age, completeness in figures.get('shown', ()):
            self._ages.add(None if age is None or offset is None else age + offset, now)
            self._completeness.add(completeness, now)
        found = {(c['peer'], str(c['address'])): c for c in figures['connections']}
        self._connections = {key: self._connections.get(key) or ConnectionWatch() for key in found}
        for key, connection in found.items():
            self._connections[key].read(connection, now)
        if not figures['enabled'] or (self.side == ROBOT and not found):
            self._silences['out'].forgive(now)
        return [self._status(figures, now)] + [
            self._connections[key].status(self.stream.name, self.side, connection, self.limits)
            for key, connection in found.items()]

    def _status(self, figures, now):
        watches, connections = self._connections.values(), figures['connections']
        age, oldest = self._ages.percentile(50, now), self._ages.percentile(99, now)
        completeness = self._completeness.percentile(50, now)
        verdict = Verdict()
        if figures['enabled']:
            self._judge_silence(verdict, figures, now)
            self._judge(verdict, completeness, age if figures['steady'] else None)
        if figures.get('problem'):
            verdict.find(WARN, figures['problem'])
        loss = judge_connections(verdict, watches, self.limits)
        return Status(self.stream.name, verdict.level, str(verdict) or ('fine' if figures['enabled'] else 'off'), {
            'side': self.side, 'stream': self.stream.name, 'topic': self.stream.topic,
            'rate in [Hz]': self._rates.per_second('in'), 'rate out [Hz]': self._rates.per_second('out'),
            'datagrams': _sum('datagrams', connections), 'lost': _sum('lost', connections),
            'loss [%]': _times(100, loss), 'completeness [%]': _times(100, completeness),
            'age p50 [ms]': _times(1e3, age), 'age p99 [ms]': _times(1e3, oldest),
            'bytes/s': sum(watch.per_second('bytes') or 0.0 for watch in watches),
            'kernel drops': _sum('kernel_drops', connections), **_by_reason('dropped', figures.get('dropped'))})

    def _judge_silence(self, verdict, figures, now):
        limit = max(self.limits.error_silence, 3 / figures['rate'] if figures['rate'] else 0.0)
        silent = {way: silence.too_long(now, limit) for way, silence in self._silences.items()}
        if self.side == ROBOT and not self._connections:
            verdict.find(WARN, 'nobody takes it')
        if self.side == OPERATOR and not self._connections and silent['out'] is not None:
            verdict.find(ERROR, 'no connection to the robot')
        elif figures['steady'] and self.side == ROBOT and silent['in'] is not None:
            verdict.find(ERROR, 'its source is silent for %.0f s' % silent['in'])
        elif figures['steady'] and silent['out'] is not None:
            verdict.find(ERROR, 'nothing is %s for %.0f s' % ('sent' if self.side == ROBOT else 'shown', silent['out']))

    def _judge(self, verdict, completeness, age):
        limits = self.limits
        verdict.at_least(age, limits.warn_age, limits.error_age, '%.0f ms old', 1e3)
        if completeness is not None and completeness < limits.warn_completeness:
            verdict.find(WARN, 'only %.0f %% complete' % (100 * completeness))


def _times(factor, value):
    return None if value is None else factor * value


def _sum(name, connections):
    """Of what the connections tell; None where none of them does."""
    told = [connection[name] for connection in connections if connection.get(name) is not None]
    return sum(told) if told else None


def _by_reason(what, counts):
    return {'%s, %s' % (what, reason): count for reason, count in sorted((counts or {}).items())}


def clock_status(estimate, counts):
    """The status of the clocks.

    :param estimate: clock_sync.Estimate or None
    :param counts: {what: how often}
    """
    level, message = (OK, 'known') if estimate else (WARN, "the robot's clock is not known: ages are not, either")
    values = {name + ' [ms]': 1e3 * seconds for name, seconds in (estimate._asdict() if estimate else {}).items()}
    return Status('clock', level, message, {'side': OPERATOR, **values, **counts})


def link_status(control, now):
    """The status of the link, by a link_control.LinkControl."""
    problem, values = control.figures(now)
    return Status('link', WARN if problem else OK, problem or 'fine', {'side': ROBOT, **values})


def problems_status(problems, side, now):
    """The status of what the node was told wrongly."""
    level, message, values = problems.verdict(now)
    return Status('settings', level, message, {'side': side, **values})


def as_message(status):
    """The diagnostic_msgs/DiagnosticStatus of a Status."""
    return DiagnosticStatus(
        name=status.name, level=status.level, message=status.message, hardware_id=socket.gethostname(),
        values=[KeyValue(key, '%.6g' % value if isinstance(value, float) else str(value))
                for key, value in status.values.items() if value is not None])


class Diagnostics:
    """Publishes statuses from a thread of its own: a simulation's clock that stands must not stop it.

    :param looks: [f(now) -> [Status, ...], ...]; one that fails leaves the others
    """

    def __init__(self, looks):
        self._looks = looks
        # of the Updater only its way of publishing: its tasks are fixed, and connections come and go
        self._updater = diagnostic_updater.Updater()
        self._thread = Repeater('diagnostics', self._tell, self._report, PERIOD)
        self._thread.start()

    def _tell(self):
        messages, now = [], time.monotonic()
        for look in self._looks:
            try:
                messages += map(as_message, look(now))
            except Exception as error:
                self._report(error)
        self._updater.publish(messages)

    def _report(self, error):
        if not rospy.is_shutdown():
            rospy.logerr_throttle_identical(60, 'diagnostics: %s' % error)

    def close(self):
        self._thread.stop()


def robot_diagnostics(streams, control, parameters, problems):
    """Begin to tell of the robot's side.

    :param streams: {name: RobotStream}, started
    :param control: link_control.LinkControl, started
    :param parameters: common.Parameters
    :param problems: problems.Problems
    :return: Diagnostics, to be closed before the streams
    """
    looks = [watch.look for watch in _watches(ROBOT, streams, parameters)]
    return Diagnostics(looks + [lambda now: [link_status(control, now), problems_status(problems, ROBOT, now)]])


def operator_diagnostics(streams, clock, parameters, problems, sent):
    """Begin to tell of the operator's side.

    :param streams: {name: OperatorStream}, started
    :param clock: clock_sync.ClockClient
    :param parameters: common.Parameters
    :param problems: problems.Problems
    :param sent: f() -> {name: StreamStatus}, what the robot said last that it sends
    :return: Diagnostics, to be closed before the streams and the clock
    """
    def look(watch, now):
        status, estimate = sent().get(watch.stream.name), clock.estimate
        return watch.look(now, estimate and estimate.offset,
                          status and {'enabled': status.enabled, 'rate': status.rate})
    looks = [functools.partial(look, watch) for watch in _watches(OPERATOR, streams, parameters)]
    return Diagnostics(looks + [lambda now: [clock_status(clock.estimate, clock.counts),
                                             problems_status(problems, OPERATOR, now)]])


def _watches(side, streams, parameters):
    limits, now = read_limits(streams, parameters), time.monotonic()
    return [StreamWatch(side, stream, limits[name], now) for name, stream in streams.items()]
