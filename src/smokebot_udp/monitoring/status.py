# SPDX-License-Identifier: BSD-3-Clause
"""A status as diagnostics show it, and the verdict from which its level and its message come."""
from typing import Any, Dict, List, Mapping, NamedTuple, Optional

OK, WARN, ERROR, STALE = 0, 1, 2, 3
LEVELS = {OK: 'OK', WARN: 'WARN', ERROR: 'ERROR', STALE: 'STALE'}
"""Levels, as in diagnostic_msgs/DiagnosticStatus."""

ROBOT, OPERATOR = 'robot', 'operator'
"""The two sides of the link."""

TO_ROBOT = 'to the robot'
"""Direction of what operators send, in the status of a stream; the others have none."""


class Kind:
    """Kinds of statuses."""
    STREAM, CONNECTION, LINK, CLOCK, CONTROL, TRANSPORT, WIFI, COMPUTER, SETTINGS, REQUESTS, REFUSED = (
        'stream', 'connection', 'link', 'clock', 'control', 'transport', 'wifi', 'computer', 'settings', 'requests',
        'refused')


class Status(NamedTuple):
    """The content of a diagnostic_msgs/DiagnosticStatus; nodes/status_messages.py makes one of the other."""
    kind: str
    """One of Kind; a node of another release may have others."""
    name: str
    """Unique in its node."""
    level: int
    message: str
    values: Mapping[str, Any]
    """{key, with its unit: value} in display order; values that are None are unknown and not published. Of a status
    that was received they are texts."""
    side: str = ''
    """ROBOT or OPERATOR; empty before it is published, as is `node`."""
    node: str = ''


class Verdict:
    """Collects problems: the worst level, and a message that names all of them."""

    def __init__(self) -> None:
        self.level = OK
        self._problems: List[str] = []

    def add(self, level: int, problem: str) -> None:
        """Add a problem, described in words; it is named once."""
        self.level = max(self.level, level)
        if problem not in self._problems:
            self._problems.append(problem)

    def check(self, value: Optional[float], warn: float, error: float, problem: str, scale: float = 1.0) -> None:
        """Add a problem if a value reaches a threshold.

        :param value: None is not checked
        :param warn, error: thresholds of the two levels, inclusive
        :param problem: description with one %f, which gets the value times `scale`
        """
        if value is not None and value >= warn:
            self.add(ERROR if value >= error else WARN, problem % (value * scale))

    def __str__(self) -> str:
        return ', '.join(self._problems)


def scaled(value: Optional[float], factor: float) -> Optional[float]:
    """A value in another unit; None stays None."""
    return None if value is None else factor * value


def by_reason(what: str, counts: Dict[str, int]) -> Dict[str, int]:
    """Counts by reason as values of a Status: {'what, reason': count}, sorted by reason."""
    return {'%s, %s' % (what, reason): count for reason, count in sorted(counts.items())}


def printable(text: str) -> str:
    """The text without control characters: text from the network must not control the terminal."""
    return ''.join(sign if sign.isascii() and sign.isprintable() else '?' for sign in text)
