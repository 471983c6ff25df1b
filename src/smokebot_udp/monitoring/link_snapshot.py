# SPDX-License-Identifier: BSD-3-Clause
"""The newest reports of all nodes as one tree of plain values, which `link_top --json` prints and its table shows.

doc/monitoring.md lists the keys. A value that is unknown is None.
"""
import math
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from .link_board import Board, robots_of
from .node_status import BY, peers_in
from .status import LEVELS, OPERATOR, ROBOT, STALE, TO_ROBOT, Kind, Status

Tree = Dict[str, Any]
Fields = Mapping[str, Tuple[str, Optional[float]]]
"""{key: (key of the status, factor of a number)}; without a factor it is a text."""

PARTS: Mapping[str, Fields] = {
    Kind.LINK: {
        'state': ('state', None), 'rate_mbit': ('rate [Mbit/s]', 1.0), 'sent_mbit': ('sent [Mbit/s]', 1.0),
        'wanted_mbit': ('wanted [Mbit/s]', 1.0), 'capacity_mbit': ('capacity [Mbit/s]', 1.0),
        'loss': ('loss [%]', 0.01), 'queue_delay': ('queue delay [ms]', 1e-3),
        'round_trip': ('round trip [ms]', 1e-3)},
    Kind.CLOCK: {'offset': ('offset [ms]', 1e-3), 'uncertainty': ('uncertainty [ms]', 1e-3),
                 'round_trip': ('round_trip [ms]', 1e-3)},
    Kind.CONTROL: {'control': ('control', None)},
    Kind.TRANSPORT: {'connected_to': ('connected to', None), 'handshakes': ('handshakes', 1.0),
                     'dropped': ('dropped', 1.0)},
    Kind.WIFI: {
        'interface': ('wifi', None), 'ssid': ('ssid', None), 'signal_dbm': ('signal [dBm]', 1.0),
        'noise_dbm': ('noise [dBm]', 1.0), 'tx_bitrate_mbit': ('tx bitrate [Mbit/s]', 1.0),
        'rx_bitrate_mbit': ('rx bitrate [Mbit/s]', 1.0), 'retries': ('retries [1/s]', 1.0),
        'failed': ('failed [1/s]', 1.0), 'beacon_loss': ('beacon loss [1/s]', 1.0)},
}
"""{kind of a status: what a node has of it}"""

CONNECTION_FIELDS: Fields = {
    'stream': ('stream', None), 'peer': ('peer', None), 'address': ('address', None), 'datagrams': ('datagrams', 1.0),
    'loss': ('loss [%]', 0.01), 'bytes_per_second': ('bytes/s', 1.0), 'kernel_drops': ('kernel drops', 1.0)}

SENDER: Fields = {'source_hz': ('rate in [Hz]', 1.0), 'sent_hz': ('rate out [Hz]', 1.0)}
RECEIVER: Fields = {
    'received_hz': ('rate in [Hz]', 1.0), 'shown_hz': ('rate out [Hz]', 1.0), 'loss': ('loss [%]', 0.01),
    'age_median': ('age p50 [ms]', 1e-3), 'age_p99': ('age p99 [ms]', 1e-3)}
ON_OPERATOR: Fields = {'completeness': ('completeness [%]', 0.01), 'error': ('error', None)}

NOT_REPORTED = Status(Kind.STREAM, '', 0, '', {})
"""Represents a side that has not reported a stream."""


class _Section(NamedTuple):
    """An operator and the robots it receives from, or a robot that no operator receives from."""
    robots: List[str]
    operator: Optional[str]


def snapshot(board: Board, now: float, only: str = '') -> Tree:
    """The tree of a board.

    :param only: name of the only operator in it: its node, or the namespace of its node; empty: all
    """
    statuses = [status for status in board.statuses(now)
                if status.side == ROBOT or not only or _is_named(status.node, only)]
    sections = _sections(statuses, bool(only))
    nodes = {node: [status for status in statuses if status.node == node]
             for section in sections for node in (*section.robots, section.operator) if node}
    age = board.age(now)
    return {
        'last_report_age': None if age is None else round(age, 3),
        'robots': [_node(node, nodes[node]) for node in sorted({node for section in sections
                                                                for node in section.robots})],
        'operators': [{**_node(section.operator, nodes[section.operator]), 'receives_from': section.robots}
                      for section in sections if section.operator],
        'streams': [stream for section in sections for stream in _streams(section, statuses)],
        'connections': [{**_said(status), **_values(status, CONNECTION_FIELDS)} for node in sorted(nodes)
                        for status in nodes[node] if status.kind == Kind.CONNECTION],
        'statuses': [{**_said(status), 'kind': status.kind, 'name': status.name, 'message': status.message}
                     for node in sorted(nodes) for status in nodes[node]
                     if status.kind not in (Kind.STREAM, Kind.CONNECTION)]}


def _is_named(node: str, name: str) -> bool:
    """Whether this is the name of a node or of its namespace."""
    name = '/' + name.strip('/')
    return node == name or node.rpartition('/')[0] == name


def _sections(statuses: Sequence[Status], received_only: bool) -> List[_Section]:
    """A section for each operator and, unless received_only, for each robot that no operator receives from."""
    robots, operators = (list(dict.fromkeys(status.node for status in statuses if status.side == side))
                         for side in (ROBOT, OPERATOR))
    sections = []
    for operator in operators:
        peers = robots_of(operator, statuses)
        partners = [robot for robot in robots if robot in peers] or (robots if len(robots) == 1 else [])
        sections.append(_Section(partners, operator))
    received = {robot for section in sections for robot in section.robots}
    lonely = [robot for robot in robots if robot not in received] if not (received_only and operators) else []
    return sections + [_Section([robot], None) for robot in lonely]


def _node(node: str, statuses: Sequence[Status]) -> Tree:
    """What is known of a node as a whole; of the parts of its side None where they are not known."""
    found = {status.kind: status for status in reversed(statuses) if status.level != STALE}
    parts = {kind: _values(found[kind], fields) if kind in found else None for kind, fields in PARTS.items()}
    control, wifi, transport = parts[Kind.CONTROL], parts[Kind.WIFI], parts[Kind.TRANSPORT]
    if transport is not None:
        transport['peers'] = peers_in(transport['connected_to'] or '')
        transport['dropped_by_reason'] = {key.partition(', ')[2]: _number(found[Kind.TRANSPORT], key)
                                          for key in found[Kind.TRANSPORT].values if key.startswith('dropped, ')}
    link = parts[Kind.LINK]
    if link is not None:
        link['paths'] = {key[len(BY):]: text for key, text in found[Kind.LINK].values.items() if key.startswith(BY)}
    own = {Kind.LINK: link} if statuses[0].side == ROBOT else {Kind.CLOCK: parts[Kind.CLOCK]}
    return {
        'node': node, 'level': LEVELS[max(status.level for status in statuses)],
        'problems': sorted({status.message for status in statuses
                            if status.level and status.kind not in (Kind.STREAM, Kind.CONNECTION)}),
        Kind.WIFI: wifi if wifi and wifi['interface'] not in (None, '-') else None, **own,
        Kind.CONTROL: control and control['control'], Kind.TRANSPORT: transport}


def _streams(section: _Section, statuses: Sequence[Status]) -> List[Tree]:
    """The streams of a section, with the robot's values beside the operator's."""
    by_stream: Dict[str, Dict[str, Status]] = {}
    for status in statuses:
        if status.kind == Kind.STREAM and status.node in (*section.robots, section.operator):
            by_stream.setdefault(status.values.get('stream', ''), {}).setdefault(status.side, status)
    return [{'robots': section.robots, 'operator': section.operator,
             **_stream(name, sides.get(ROBOT, NOT_REPORTED), sides.get(OPERATOR, NOT_REPORTED))}
            for name, sides in by_stream.items()]


def _stream(name: str, robot: Status, operator: Status) -> Tree:
    back = TO_ROBOT in (robot.values.get('direction'), operator.values.get('direction'))
    sender, receiver = (operator, robot) if back else (robot, operator)
    return {
        'stream': name, 'to_robot': back, 'level': LEVELS[max(robot.level, operator.level)],
        'problems': ['%s: %s' % (status.side, status.message) for status in (robot, operator) if status.level],
        **_values(sender, SENDER), 'sent_at_most_hz': _number(robot, 'at most [Hz]'), **_values(receiver, RECEIVER),
        **_values(operator, ON_OPERATOR),
        'bytes_per_second': _number(robot if operator is NOT_REPORTED else operator, 'bytes/s')}


def _said(status: Status) -> Tree:
    """Who says what of itself."""
    return {'node': status.node, 'side': status.side, 'level': LEVELS[status.level],
            'problems': [status.message] if status.level else []}


def _values(status: Status, fields: Fields) -> Tree:
    return {name: status.values.get(key) if factor is None else _number(status, key, factor)
            for name, (key, factor) in fields.items()}


def _number(status: Status, key: str, factor: float = 1.0) -> Optional[float]:
    """A finite number of a status times `factor`; None: there is none, or it is too old."""
    try:
        number = float(status.values.get(key, '')) * factor
    except ValueError:
        return None
    return round(number, 6) if math.isfinite(number) and status.level != STALE else None
