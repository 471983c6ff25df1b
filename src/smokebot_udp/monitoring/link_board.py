# SPDX-License-Identifier: BSD-3-Clause
"""The newest reports of all nodes, for link_top."""
import math
from typing import Dict, List, Optional, Sequence, Set, Tuple

from ..newest import Newest
from .status import ROBOT, STALE, Kind, Status

STALE_AFTER = 3.0
"""A node without a report for this long is shown as STALE [s]; nodes report once a second."""

MAX_NODES = 32
"""Number of nodes whose reports are kept, the newest."""

OWN = ''
"""The part of a node's reports that are its own diagnostics; other parts are relayed of its robot."""

DIAGNOSTICS = 'diagnostic_msgs/DiagnosticArray'
"""The part of what is relayed of a robot that has all the others."""

UNKNOWN_ROBOT = '/robot'
"""Name of a robot that is known only by relayed reports."""

Report = Tuple[float, List[Status]]
"""When it came [s], and its content."""


def robots_of(operator: str, statuses: Sequence[Status]) -> List[str]:
    """The names of the robots that an operator's node receives from, one for each connection.

    Robots with masters of their own may have the same name. They differ by their addresses.

    :param statuses: those of other nodes are ignored
    """
    own = [status for status in statuses if status.node == operator]
    own_masters = any(status.kind == Kind.TRANSPORT for status in own)
    return [status.values.get('peer', '-') + (' at ' + status.values.get('address', '-') if own_masters else '')
            for status in own if status.kind == Kind.CONNECTION]


class Board:
    """The last report of each node. Time is an argument: seconds of a monotonic clock.

    Diagnostics cross the link by TCP, and stop where it is bad. Each operator's node also relays, by UDP, what its
    robot reports of the link and of its streams.
    """

    def __init__(self) -> None:
        self._nodes: Newest[str, Dict[str, Report]] = Newest(MAX_NODES)     # {node: {part: its newest report}}

    def add(self, statuses: Sequence[Status], now: float) -> None:
        """Add the content of one DiagnosticArray; it replaces the earlier reports of its nodes."""
        for node in {status.node for status in statuses}:
            self._put(node, OWN, [status for status in statuses if status.node == node], now)

    def add_relayed(self, operator: str, part: str, statuses: Sequence[Status], now: float) -> None:
        """Add a part of what an operator's node relays of its robot; it replaces the same part relayed earlier.

        :param operator: the operator's node
        :param statuses: of the robot, whose node's name may be unknown
        """
        self._put(operator, part, list(statuses), now)

    def _put(self, node: str, part: str, statuses: List[Status], now: float) -> None:
        self._nodes.of(node, dict)[part] = now, statuses

    @property
    def sides(self) -> Set[str]:
        """The sides whose diagnostics came."""
        return {status.side for _, statuses in self._own().values() for status in statuses}

    def age(self, now: float) -> Optional[float]:
        """Time since the last report [s]; None without any."""
        return min((now - when for reports in self._known(now).values() for when, _ in reports), default=None)

    def statuses(self, now: float) -> List[Status]:
        """All statuses, sorted by their nodes' names; those that are too old are STALE."""
        return [status if now - when <= STALE_AFTER
                else status._replace(level=STALE, message='silent for %.0f s' % (now - when))
                for _, reports in sorted(self._known(now).items()) for when, statuses in reports for status in statuses]

    def _own(self) -> Dict[str, Report]:
        """{node: its own diagnostics}"""
        return {node: parts[OWN] for node, parts in self._nodes.items() if OWN in parts}

    def _known(self, now: float) -> Dict[str, List[Report]]:
        """{node: its reports}; what was relayed of a robot counts where its own report is missing, or too old and
        older."""
        own = self._own()
        relayed: Dict[str, List[Tuple[str, Report]]] = {}
        for operator, parts in self._nodes.items():
            of_robot = [(part, report) for part, report in parts.items() if part != OWN]
            if of_robot:
                relayed.setdefault(self._robot_of(operator, own), []).extend(of_robot)
        known = {node: [report] for node, report in own.items()}
        for robot, reports in relayed.items():
            when = own[robot][0] if robot in own else -math.inf
            if now - when > STALE_AFTER and max(came for _, (came, _) in reports) > when:
                known[robot] = _merged(robot, reports, now)
        return known

    @staticmethod
    def _robot_of(operator: str, own: Dict[str, Report]) -> str:
        """The robot that an operator's node receives from."""
        peers = robots_of(operator, own.get(operator, (0.0, []))[1])
        robots = [node for node, (_, statuses) in own.items() if any(status.side == ROBOT for status in statuses)]
        return peers[0] if peers else robots[0] if len(robots) == 1 else UNKNOWN_ROBOT


def _merged(robot: str, parts: Sequence[Tuple[str, Report]], now: float) -> List[Report]:
    """What is relayed of a robot: its diagnostics alone while they come, else of each status the newest of the other
    parts, and what only the old diagnostics have."""
    ordered = sorted(parts, key=lambda item: (item[0] == DIAGNOSTICS, -item[1][0]))
    whole = [report for part, report in ordered if part == DIAGNOSTICS and now - report[0] <= STALE_AFTER]
    merged: List[Report] = []
    known: Set[Tuple[str, str]] = set()
    for when, statuses in whole[:1] or [report for _, report in ordered]:
        left = [status._replace(node=robot) for status in statuses if (status.kind, status.name) not in known]
        merged.append((when, left))
        known.update((status.kind, status.name) for status in left)
    return merged
