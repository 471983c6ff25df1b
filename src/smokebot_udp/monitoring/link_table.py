# SPDX-License-Identifier: BSD-3-Clause
"""The table of link_top: the newest reports of all nodes, rendered as lines of text."""
import collections
import math
from typing import DefaultDict, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from .status import OPERATOR, ROBOT

LEVELS = {0: 'OK', 1: 'WARN', 2: 'ERROR', 3: 'STALE'}
"""As in diagnostic_msgs/DiagnosticStatus."""

STALE = 3
STALE_AFTER = 3.0
"""A node without a report for this long is shown as STALE [s]; nodes report once a second."""

MAX_NODES = 32
"""Number of nodes whose reports are kept, the newest."""

KINDS = {'topic': 'stream', 'peer': 'connection', 'jumps': 'clock', 'state': 'link', 'problems': 'settings',
         'refused requests': 'requests'}
"""{value that only this kind of status has: kind}"""

STREAM_COLUMNS = (
    ('LEVEL', -6), ('STREAM', -18), ('SOURCE', 7), ('SENT', 6), ('CAME', 6), ('SHOWN', 6), ('LOSS %', 7),
    ('COMPL %', 8), ('AGE ms', 8), ('p99', 7), ('kB/s', 8))
"""(heading, width), negative: left-aligned and cut. The rates [Hz] are those of the robot's source, of the messages it
sends, of those received, and of those published for the operator."""

CONNECTION_COLUMNS = (
    ('LEVEL', -6), ('STREAM', -18), ('SIDE', -9), ('PEER', -24), ('ADDRESS', -22), ('DATAGRAMS', 11), ('LOSS %', 7),
    ('kB/s', 8), ('DROPS', 7))
"""Drops are the kernel's: the socket's receive buffer was full."""

Columns = Sequence[Tuple[str, int]]


class NodeStatus(NamedTuple):
    """One status of a node."""
    node: str
    level: int
    message: str
    values: Mapping[str, str]
    """`side`, robot or operator, is always among them."""

    @property
    def kind(self) -> str:
        """One of the values of KINDS, or other."""
        return next((kind for key, kind in KINDS.items() if key in self.values), 'other')

    @property
    def stream(self) -> str:
        """The name of the stream that it is about; empty: none."""
        return self.values.get('stream', '')

    def number(self, key: str, digits: int, factor: float = 1.0) -> str:
        """A value times `factor`, rounded; - where it is not a finite number."""
        try:
            number = float(self.values.get(key, ''))
        except ValueError:
            return '-'
        return '%.*f' % (digits, number * factor) if math.isfinite(number) else '-'


NOT_REPORTED = NodeStatus('', 0, '', {'side': ''})
"""Represents a side that has not reported a stream."""


class Line(NamedTuple):
    """A line of the table."""
    text: str
    level: Optional[int] = None
    """The level whose colour the first word gets; None: no colour."""


def printable(text: str) -> str:
    """The text without control characters: text from the network must not control the terminal."""
    return ''.join(sign if sign.isascii() and sign.isprintable() else '?' for sign in text)


class Board:
    """The last report of each node. Time is an argument: seconds of a monotonic clock."""

    def __init__(self) -> None:
        self._reports: collections.OrderedDict[str, Tuple[float, List[NodeStatus]]] = collections.OrderedDict()
        """{node: (when its last report came, its content)}, the newest last"""

    def add(self, statuses: Sequence[NodeStatus], now: float) -> None:
        """Add the content of one DiagnosticArray; it replaces the earlier reports of its nodes."""
        for node in {status.node for status in statuses}:
            self._reports[node] = now, [status for status in statuses if status.node == node]
            self._reports.move_to_end(node)
        while len(self._reports) > MAX_NODES:
            self._reports.popitem(last=False)

    @property
    def sides(self) -> Set[str]:
        """The sides that have reported."""
        return {status.values['side'] for _, statuses in self._reports.values() for status in statuses}

    def age(self, now: float) -> Optional[float]:
        """Time since the last report [s]; None without any."""
        return min((now - when for when, _ in self._reports.values()), default=None)

    def statuses(self, now: float) -> List[NodeStatus]:
        """All statuses, sorted by their nodes' names; those that are too old are STALE."""
        return [status if now - when <= STALE_AFTER
                else status._replace(level=STALE, message='silent for %.0f s' % (now - when))
                for _, (when, statuses) in sorted(self._reports.items()) for status in statuses]


def render(board: Board, now: float) -> Tuple[List[Line], List[Line]]:
    """The whole table: (lines that stay at the top, lines that may scroll)."""
    age = board.age(now)
    if age is None:
        return [Line('smokebot_udp link: no report on /diagnostics yet')], []
    by_kind: DefaultDict[str, List[NodeStatus]] = collections.defaultdict(list)
    for status in board.statuses(now):
        by_kind[status.kind].append(status)
    missing = ''.join(', no report of the ' + side for side in (ROBOT, OPERATOR) if side not in board.sides)
    top = [Line('smokebot_udp link: last report %.1f s ago%s' % (age, missing))]
    top += map(_link_line, by_kind['link'])
    top += map(_clock_line, by_kind['clock'])
    top += [_line(status, '%s: %s' % (status.node, status.message))
            for status in by_kind['settings'] + by_kind['requests'] if status.level]
    body = [_headings(STREAM_COLUMNS)] + _stream_lines(by_kind['stream'])
    if by_kind['connection']:
        body += [Line(''), _headings(CONNECTION_COLUMNS)]
        body += map(_connection_line, by_kind['connection'])
    return top, body


def _line(status: NodeStatus, text: str) -> Line:
    return Line('%-6s %s' % (LEVELS[status.level], text), status.level)


def _link_line(status: NodeStatus) -> Line:
    sent, rate, wanted, capacity = (
        status.number('%s [Mbit/s]' % name, 1) for name in ('sent', 'rate', 'wanted', 'capacity'))
    return _line(status, 'link: %s of %s Mbit/s sent, %s wanted, %s carried; queue %s ms, loss %s %%, '
                 'round trip %s ms; %s' % (
                     sent, rate, wanted, capacity, status.number('queue delay [ms]', 0), status.number('loss [%]', 0),
                     status.number('round trip [ms]', 0),
                     status.message if status.level == STALE else status.values['state']))


def _clock_line(status: NodeStatus) -> Line:
    if 'offset [ms]' not in status.values or status.level == STALE:
        return _line(status, 'clock: ' + status.message)
    return _line(status, "clock: the robot's is ahead by %s ms +- %s, round trip %s ms" % (
        status.number('offset [ms]', 1), status.number('uncertainty [ms]', 1), status.number('round_trip [ms]', 1)))


def _stream_lines(statuses: Sequence[NodeStatus]) -> List[Line]:
    """A line for each stream and operator, with the robot's values beside the operator's."""
    by_stream: Dict[str, Dict[str, List[NodeStatus]]] = {}
    for status in statuses:
        by_stream.setdefault(status.stream, {ROBOT: [], OPERATOR: []})[status.values['side']].append(status)
    several = len({status.node for status in statuses if status.values['side'] == OPERATOR}) > 1
    return [_stream_line(name, sides[ROBOT][0] if sides[ROBOT] else NOT_REPORTED, operator, several)
            for name, sides in by_stream.items() for operator in sides[OPERATOR] or [NOT_REPORTED]]


def _stream_line(name: str, robot: NodeStatus, operator: NodeStatus, several_operators: bool) -> Line:
    level = max(robot.level, operator.level)
    notes = ['at ' + operator.node] if several_operators and operator is not NOT_REPORTED else []
    notes += ['%s: %s' % (status.values['side'], status.message) for status in (robot, operator) if status.level]
    sender = operator if operator is not NOT_REPORTED else robot
    return Line(_row(STREAM_COLUMNS, [
        LEVELS[level], name,
        robot.number('rate in [Hz]', 1), robot.number('rate out [Hz]', 1),
        operator.number('rate in [Hz]', 1), operator.number('rate out [Hz]', 1),
        operator.number('loss [%]', 1), operator.number('completeness [%]', 0),
        operator.number('age p50 [ms]', 0), operator.number('age p99 [ms]', 0),
        sender.number('bytes/s', 1, 1e-3)], notes), level)


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
