# SPDX-License-Identifier: BSD-3-Clause
"""The table of link_top: the newest reports of all nodes, rendered as lines of text."""
from typing import Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

from .link_board import LEVELS, STALE, Board, NodeStatus, robots_of
from .status import OPERATOR, ROBOT, TO_ROBOT

ERROR_WIDTH = 13
STREAM_COLUMNS = (
    ('LEVEL', -6), ('STREAM', -18), ('SOURCE', 7), ('SENT', 6), ('CAME', 6), ('SHOWN', 6), ('LOSS %', 7),
    ('COMPL %', 8), ('ERROR', ERROR_WIDTH), ('AGE ms', 8), ('p99', 7), ('kB/s', 8))
"""(heading, width), negative: left-aligned and cut. The rates [Hz] are those of the source, of the messages sent (<=
the most that may be, where only that is known), of those received, and of those published. The source of commands is
at the operator's side, all others are at the robot. The error is that of layered images, the median."""

CONNECTION_COLUMNS = (
    ('LEVEL', -6), ('STREAM', -18), ('SIDE', -9), ('PEER', -24), ('ADDRESS', -22), ('DATAGRAMS', 11), ('LOSS %', 7),
    ('kB/s', 8), ('DROPS', 7))
"""Drops are the kernel's: the socket's receive buffer was full. With own masters all streams have one socket, and these
are shares of its drops."""

UNITS = ('days', 86400.0, 1), ('h', 3600.0, 2), ('min', 60.0, 1), ('s', 1.0, 2), ('ms', 1e-3, 1)
"""(name, [s], digits) of an offset: a clock of another epoch is off by years."""

Columns = Sequence[Tuple[str, int]]


NOT_REPORTED = NodeStatus('', 0, '', {'side': ''})
"""Represents a side that has not reported a stream."""


class Line(NamedTuple):
    """A line of the table."""
    text: str
    level: Optional[int] = None
    """The level whose colour the first word gets; None: no colour."""


class Section(NamedTuple):
    """An operator and the robots it receives from, or a robot that no operator receives from."""
    title: str
    robots: List[str]
    operator: Optional[str]


def render(board: Board, now: float, only: str = '', short: bool = False) -> Tuple[List[Line], List[Line]]:
    """The whole table: (lines that stay at the top, lines that may scroll).

    :param only: name of the only operator to show: its node, or the namespace of its node; empty: all
    :param short: without connections that are fine
    """
    age = board.age(now)
    if age is None:
        return [Line('smokebot_udp link: no report on /diagnostics yet')], []
    statuses, sections = sections_of(board, now, only)
    missing = ''.join(', no report of the %s%s' % (side, ' ' + only if only and side == OPERATOR else '')
                      for side in (ROBOT, OPERATOR) if not _nodes(statuses, side))
    top = [Line('smokebot_udp link: last report %.1f s ago%s' % (age, missing))]
    for kind, line, side in (('link', _link_line, ROBOT), ('clock', _clock_line, OPERATOR)):
        several = len(_nodes(statuses, side)) > 1
        top += [line(status, ' of ' + status.node if several else '') for status in statuses if status.kind == kind]
    top += [_line(status, '%s: %s' % (status.node, status.values['control'])) for status in statuses
            if status.kind == 'control']
    top += [_transport_line(status) for status in statuses if status.kind == 'transport']
    top += [_wifi_line(status) for status in statuses if status.kind == 'wifi']
    top += [_line(status, '%s: %s' % (status.node, status.message)) for status in statuses
            if status.kind in ('settings', 'requests', 'refused') and status.level]
    body: List[Line] = []
    for section in sections:
        body += [Line(''), Line(section.title)] if len(sections) > 1 else []
        body += [_headings(STREAM_COLUMNS)] + _stream_lines(section, statuses)
    connections = [_connection_line(status) for status in statuses
                   if status.kind == 'connection' and (status.level or not short)]
    return top, body + ([Line(''), _headings(CONNECTION_COLUMNS)] + connections if connections else [])


def sections_of(board: Board, now: float, only: str = '') -> Tuple[List[NodeStatus], List[Section]]:
    """What is shown of a board: (statuses, sections).

    :param only: see render
    """
    statuses = [status for status in board.statuses(now)
                if status.values['side'] == ROBOT or not only or _is_named(status.node, only)]
    sections = _sections(statuses, bool(only))
    shown = {node for section in sections for node in (*section.robots, section.operator)}
    statuses = [status for status in statuses if status.node in shown]
    return statuses, sections


def _is_named(node: str, name: str) -> bool:
    """Whether this is the name of a node or of its namespace."""
    name = '/' + name.strip('/')
    return node == name or node.rpartition('/')[0] == name


def _nodes(statuses: Sequence[NodeStatus], side: str) -> List[str]:
    """The nodes of one side, in their order."""
    return list(dict.fromkeys(status.node for status in statuses if status.values['side'] == side))


def _sections(statuses: Sequence[NodeStatus], received_only: bool) -> List[Section]:
    """A section for each operator and, unless received_only, for each robot that no operator receives from."""
    robots, operators = _nodes(statuses, ROBOT), _nodes(statuses, OPERATOR)
    sections, received = [], set()
    for operator in operators:
        peers = robots_of(operator, statuses)
        partners = [robot for robot in robots if robot in peers] or (robots if len(robots) == 1 else [])
        received.update(partners)
        sections.append(Section('%s receives from %s' % (operator, ', '.join(partners) or 'no robot that reports'),
                                partners, operator))
    lonely = [robot for robot in robots if robot not in received] if not (received_only and operators) else []
    return sections + [Section(robot, [robot], None) for robot in lonely]


def _line(status: NodeStatus, text: str) -> Line:
    return Line('%-6s %s' % (LEVELS[status.level], text), status.level)


def _link_line(status: NodeStatus, whose: str) -> Line:
    sent, rate, wanted, capacity = (
        status.number('%s [Mbit/s]' % name, 1) for name in ('sent', 'rate', 'wanted', 'capacity'))
    return _line(status, 'link%s: %s of %s Mbit/s sent, %s wanted, %s carried; queue %s ms, loss %s %%, '
                 'round trip %s ms; %s' % (
                     whose, sent, rate, wanted, capacity, status.number('queue delay [ms]', 0),
                     status.number('loss [%]', 0), status.number('round trip [ms]', 0),
                     status.message if status.level == STALE else _with_problem(status)))


def _with_problem(status: NodeStatus) -> str:
    """The state of the link, and what is wrong."""
    state = status.values['state']
    return state if not status.level else status.message if state in status.message else '; '.join(
        (state, status.message))


def _clock_line(status: NodeStatus, whose: str) -> Line:
    if 'offset [ms]' not in status.values or status.level == STALE:
        return _line(status, 'clock%s: %s' % (whose, status.message))
    return _line(status, "clock%s: the robot's is %s +- %s ms, round trip %s ms" % (
        whose, offset_text(status.values['offset [ms]']), status.number('uncertainty [ms]', 1),
        status.number('round_trip [ms]', 1)))


def offset_text(milliseconds: str) -> str:
    """The offset of a clock in a readable unit.

    :param milliseconds: a number as a text
    """
    try:
        seconds = float(milliseconds) / 1e3
    except ValueError:
        return 'ahead by ?'
    unit, size, digits = next((unit for unit in UNITS if abs(seconds) >= unit[1]), UNITS[-1])
    return '%s by %.*f %s' % ('behind' if seconds < 0 else 'ahead', digits, abs(seconds) / size, unit)


def _wifi_line(status: NodeStatus) -> Line:
    values = status.values
    text = '-' if values['wifi'] == '-' or status.level == STALE else status.message if status.level else \
        '%s%s: signal %s dBm, noise %s dBm; sends at %s, receives at %s Mbit/s; %s retries/s, %s failed/s' % (
            values['wifi'], ' in %s' % values['ssid'] if 'ssid' in values else '', *(
                status.number(key, digits) for key, digits in (
                    ('signal [dBm]', 0), ('noise [dBm]', 0), ('tx bitrate [Mbit/s]', 1), ('rx bitrate [Mbit/s]', 1),
                    ('retries [1/s]', 0), ('failed [1/s]', 0))))
    return _line(status, 'Wi-Fi of %s: %s' % (status.node, text))


def _transport_line(status: NodeStatus) -> Line:
    values = status.values
    reasons = ', '.join('%s %s' % (count, key.split(', ', 1)[1]) for key, count in values.items()
                        if key.startswith('dropped, '))
    text = 'with %s; sealed: %s; handshakes: %s; dropped: %s%s' % (
        values.get('connected to', '-'), values.get('sealed', '-'), status.number('handshakes', 0),
        status.number('dropped', 0), ' (%s)' % reasons if reasons else '')
    return _line(status, '%s %s%s' % (status.node, text, '; ' + status.message if status.level else ''))


def _stream_lines(section: Section, statuses: Sequence[NodeStatus]) -> List[Line]:
    """A line for each stream of a section, with the robot's values beside the operator's."""
    return [_stream_line(name, sides.get(ROBOT, NOT_REPORTED), sides.get(OPERATOR, NOT_REPORTED))
            for name, sides in streams_of(section, statuses).items()]


def streams_of(section: Section, statuses: Sequence[NodeStatus]) -> Dict[str, Dict[str, NodeStatus]]:
    """{stream: {side: its status}} of a section."""
    by_stream: Dict[str, Dict[str, NodeStatus]] = {}
    for status in statuses:
        if status.kind == 'stream' and status.node in (*section.robots, section.operator):
            by_stream.setdefault(status.stream, {}).setdefault(status.values['side'], status)
    return by_stream


def _stream_line(name: str, robot: NodeStatus, operator: NodeStatus) -> Line:
    level = max(robot.level, operator.level)
    notes = ['%s: %s' % (status.values['side'], status.message) for status in (robot, operator) if status.level]
    counted = operator if operator is not NOT_REPORTED else robot
    most = robot.number('at most [Hz]', 1)
    back = TO_ROBOT in (robot.values.get('direction'), operator.values.get('direction'))
    sender, receiver = (operator, robot) if back else (robot, operator)
    return Line(_row(STREAM_COLUMNS, [
        LEVELS[level], name,
        sender.number('rate in [Hz]', 1), sender.number('rate out [Hz]', 1) if most == '-' else '<=' + most,
        receiver.number('rate in [Hz]', 1), receiver.number('rate out [Hz]', 1),
        receiver.number('loss [%]', 1), operator.number('completeness [%]', 0),
        operator.values.get('error', '-')[:ERROR_WIDTH],
        receiver.number('age p50 [ms]', 0), receiver.number('age p99 [ms]', 0),
        counted.number('bytes/s', 1, 1e-3)], notes), level)


def _connection_line(status: NodeStatus) -> Line:
    values = status.values
    return Line(_row(CONNECTION_COLUMNS, [
        LEVELS[status.level], status.stream, values['side'], values['peer'], values.get('address', ''),
        status.number('datagrams', 0), status.number('loss [%]', 1), status.number('bytes/s', 1, 1e-3),
        status.number('kernel drops', 0)], [status.message] if status.level else []), status.level)


def _headings(columns: Columns) -> Line:
    return Line(_row(columns, [heading for heading, _ in columns]))


def _row(columns: Columns, cells: Iterable[str], notes: Sequence[str] = ()) -> str:
    """Cells in their columns, followed by notes."""
    texts = ['%-*s' % (-width, cell[:-width]) if width < 0 else '%*s' % (width, cell)
             for (_, width), cell in zip(columns, cells)]
    return '  '.join([' '.join(texts), *notes]).rstrip()
