# SPDX-License-Identifier: BSD-3-Clause
"""The newest reports of all nodes, for the table of link_top."""
import math
from typing import Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from ..newest import Newest
from .status import ROBOT

LEVELS = {0: 'OK', 1: 'WARN', 2: 'ERROR', 3: 'STALE'}
"""As in diagnostic_msgs/DiagnosticStatus."""

STALE = 3
STALE_AFTER = 3.0
"""A node without a report for this long is shown as STALE [s]; nodes report once a second."""

MAX_NODES = 32
"""Number of nodes whose reports are kept, the newest."""

KINDS = {'topic': 'stream', 'peer': 'connection', 'jumps': 'clock', 'state': 'link', 'problems': 'settings',
         'refused requests': 'requests', 'handshakes': 'transport', 'control': 'control', 'wifi': 'wifi',
         'refused': 'refused'}
"""{value that only this kind of status has: kind}"""

DIAGNOSTICS = 'diagnostic_msgs/DiagnosticArray'
"""The part of what is relayed of a robot that has all the others."""

UNKNOWN_ROBOT = '/robot'
"""Name of a robot that is known only by relayed reports."""

Report = Tuple[float, List['NodeStatus']]
"""When it came [s], and its content."""


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


def printable(text: str) -> str:
    """The text without control characters: text from the network must not control the terminal."""
    return ''.join(sign if sign.isascii() and sign.isprintable() else '?' for sign in text)


def robots_of(operator: str, statuses: Sequence[NodeStatus]) -> List[str]:
    """The names of the robots that an operator's node receives from, one for each connection.

    Robots with masters of their own may have the same name. They differ by their addresses.

    :param statuses: those of other nodes are ignored
    """
    own = [status for status in statuses if status.node == operator]
    own_masters = any(status.kind == 'transport' for status in own)
    return [status.values['peer'] + (' at ' + status.values.get('address', '-') if own_masters else '')
            for status in own if status.kind == 'connection']


class Board:
    """The last report of each node. Time is an argument: seconds of a monotonic clock.

    Diagnostics cross the link by TCP, and stop where it is bad. Each operator's node also relays, by UDP, what its
    robot reports of the link and of its streams.
    """

    def __init__(self) -> None:
        self._reports: Newest[str, Report] = Newest(MAX_NODES)      # by node
        self._relayed: Newest[str, Dict[str, Report]] = Newest(MAX_NODES)   # by operator and part

    def add(self, statuses: Sequence[NodeStatus], now: float) -> None:
        """Add the content of one DiagnosticArray; it replaces the earlier reports of its nodes."""
        for node in {status.node for status in statuses}:
            self._reports[node] = now, [status for status in statuses if status.node == node]

    def add_relayed(self, operator: str, part: str, statuses: Sequence[NodeStatus], now: float) -> None:
        """Add a part of what an operator's node relays of its robot; it replaces the same part relayed earlier.

        :param operator: the operator's node
        :param statuses: of the robot, whose node's name is unknown
        """
        self._relayed.of(operator, dict)[part] = now, list(statuses)

    @property
    def sides(self) -> Set[str]:
        """The sides whose diagnostics came."""
        return {status.values['side'] for _, statuses in self._reports.values() for status in statuses}

    def age(self, now: float) -> Optional[float]:
        """Time since the last report [s]; None without any."""
        return min((now - when for reports in self._known(now).values() for when, _ in reports), default=None)

    def statuses(self, now: float) -> List[NodeStatus]:
        """All statuses, sorted by their nodes' names; those that are too old are STALE."""
        return [status if now - when <= STALE_AFTER
                else status._replace(level=STALE, message='silent for %.0f s' % (now - when))
                for _, reports in sorted(self._known(now).items()) for when, statuses in reports for status in statuses]

    def _known(self, now: float) -> Dict[str, List[Report]]:
        """{node: its report}; what was relayed of a robot counts where its own report is missing or too old, and of
        each part from when that came."""
        known = {node: [report] for node, report in self._reports.items()}
        for operator, parts in self._relayed.items():
            robot = self._robot_of(operator)
            if now - parts.get(DIAGNOSTICS, (-math.inf, []))[0] <= STALE_AFTER:
                parts = {DIAGNOSTICS: parts[DIAGNOSTICS]}
            newest = max(came for came, _ in parts.values())
            fresh = robot in self._reports and now - self._reports[robot][0] <= STALE_AFTER
            if robot not in known or (not fresh and newest > max(came for came, _ in known[robot])):
                # old diagnostics last: what the others have is newer
                known[robot] = _merged(robot, [parts[part] for part in sorted(parts, key=DIAGNOSTICS.__eq__)])
        return known

    def _robot_of(self, operator: str) -> str:
        """The robot that an operator's node receives from."""
        peers = robots_of(operator, self._reports.get(operator, (0.0, []))[1])
        robots = [node for node, (_, reported) in self._reports.items()
                  if any(status.values['side'] == ROBOT for status in reported)]
        return peers[0] if peers else robots[0] if len(robots) == 1 else UNKNOWN_ROBOT


def _merged(robot: str, parts: Iterable[Report]) -> List[Report]:
    """The parts of what is relayed of a robot, without what a part before has."""
    merged: List[Report] = []
    replaced: Set[Tuple[str, ...]] = set()
    for when, statuses in parts:
        left = [status._replace(node=robot) for status in statuses if _subject(status) not in replaced]
        merged.append((when, left))
        replaced.update(map(_subject, left))
    return merged


def _subject(status: NodeStatus) -> Tuple[str, ...]:
    """What a status is about."""
    return status.kind, status.stream, status.values.get('peer', '')
