# SPDX-License-Identifier: BSD-3-Clause
"""Statuses as diagnostic_msgs/DiagnosticStatus and back, and those that relayed messages of a robot stand for.

A status' kind and side are values of its message.
"""
import socket
from dataclasses import fields
from typing import Any, Callable, Dict, Iterable, List

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from ..mission.parameters import EXCHANGES
from ..monitoring.node_status import BY, HOLE, control_text, path_text
from ..monitoring.stats import PAUSED, PROBLEM
from ..monitoring.status import LEVELS, OK, OPERATOR, ROBOT, STALE, WARN, Kind, Status, printable
from ..monitoring.wifi import WifiState, wifi_status
from ..msg import LinkStatus, RobotStatus

MAX_RELAYED = 256
"""Streams, operators and problems of a relayed RobotStatus that are read."""


MAX_PATHS = 2
"""Paths of a relayed LinkStatus that are read."""


def as_message(status: Status, side: str) -> Any:
    """The DiagnosticStatus of a Status.

    :param side: ROBOT or OPERATOR
    """
    own = {'side': side, 'kind': status.kind}
    return DiagnosticStatus(
        name=status.name, level=status.level, message=status.message, hardware_id=socket.gethostname(),
        values=[KeyValue(key, '%.6g' % value if isinstance(value, float) else str(value))
                for key, value in {**own, **status.values, **own}.items() if value is not None])


def statuses_of(messages: Iterable[Any]) -> List[Status]:
    """The statuses of DiagnosticStatus messages; those of other packages are left out."""
    statuses = []
    for message in messages:
        values = {printable(pair.key): printable(pair.value) for pair in message.values}
        side, kind = values.pop('side', ''), values.pop('kind', '')
        node, _, name = printable(message.name).partition(': ')
        if side in (ROBOT, OPERATOR):
            statuses.append(Status(kind, name, message.level if message.level in LEVELS else STALE,
                                   printable(message.message), values, side, full_name(node)))
    return statuses


def full_name(node: str) -> str:
    """The name of a node with its first slash, which diagnostics leave out."""
    return '/' + printable(node).lstrip('/')


def relayed_link(message: Any) -> List[Status]:
    """What a relayed LinkStatus reports, as link_status and wifi_status of monitoring/ do."""
    wifi = wifi_status(WifiState(**{field.name: getattr(message.wifi, field.name) for field in fields(WifiState)}))
    problems = [message.state] * bool(PROBLEM.fullmatch(message.state))
    problems += [HOLE % message.longest_datagram] if message.longest_datagram else []
    link = Status(Kind.LINK, 'link control', WARN if problems else OK, ', '.join(problems) or message.state, {
        'state': message.state,
        **{'%s [Mbit/s]' % name: getattr(message, name) for name in ('sent', 'rate', 'wanted', 'capacity')},
        'loss [%]': 100 * message.loss, 'queue delay [ms]': 1e3 * message.queue_delay,
        'round trip [ms]': 1e3 * message.round_trip,
        **{BY + path.name: path_text(path.sent, path.capacity, path.loss) for path in message.paths[:MAX_PATHS]}})
    return _as_received([link, wifi])


def problems_of(message: Any) -> Dict[str, str]:
    """{stream: what is wrong with it} of a relayed RobotStatus."""
    return {name: why for name, _, why in (text.partition(': ') for text in message.problems[:MAX_RELAYED])}


def relayed_streams(message: Any) -> List[Status]:
    """What a relayed RobotStatus reports: who drives, and how often each stream may be sent at most."""
    problems = problems_of(message)
    control = control_text(message.driver, message.estop, message.operators[:MAX_RELAYED])
    statuses = [Status(Kind.CONTROL, 'control', WARN if message.estop else OK, control, {'control': control})]
    for stream in message.streams[:MAX_RELAYED]:
        if stream.type in EXCHANGES:
            continue
        problem = problems.pop(stream.name, PAUSED if stream.paused else '')
        rate = min([stream.rate] + [limit.value for limit in stream.granted if limit.name == 'rate'])
        statuses.append(Status(Kind.STREAM, stream.name, WARN if problem else OK, problem or 'fine', {
            'stream': stream.name, 'at most [Hz]': rate if stream.enabled and not stream.paused else 0.0}))
    return _as_received(statuses + [Status(Kind.STREAM, name, WARN, why, {'stream': name})
                                    for name, why in problems.items()])


def _as_received(statuses: Iterable[Status]) -> List[Status]:
    """Statuses of a robot as if it had published them in diagnostics; the name of its node is unknown."""
    return statuses_of(as_message(status._replace(name='robot: ' + status.name), ROBOT) for status in statuses)


def relayed_diagnostics(message: Any) -> List[Status]:
    """The statuses of robots in relayed diagnostics; with a shared master those of operators are relayed, too."""
    return [status for status in statuses_of(message.status) if status.side == ROBOT]


RELAYED: Dict[Any, Callable[[Any], List[Status]]] = {
    LinkStatus: relayed_link, RobotStatus: relayed_streams, DiagnosticArray: relayed_diagnostics}
"""{message type: f(message) -> statuses}"""
