# SPDX-License-Identifier: BSD-3-Clause
"""When a message passes the stages of its way, and how long it is in each: the budget of its age.

Both nodes and the programs around them write marks (stream, stamp of the message, stage, time); here they are joined.
All times are of one machine's steady clock, so both nodes must run there.
"""
import math
from typing import Dict, Iterable, Iterator, List, Mapping, NamedTuple, Sequence, Tuple

STAMPED, RECEIVED, STARTED, ENCODED, FIRST_SENT, LAST_SENT = (
    'stamped', 'received', 'started', 'encoded', 'first sent', 'last sent')
"""On the robot's side: the source has stamped the message, robot_sender has received it, begins to encode it and has
done so, its first datagram leaves, its last one has left."""

ARRIVED, TAKEN, ASSEMBLED, PUBLISHED, SEEN, DRAWN = 'arrived', 'taken', 'assembled', 'published', 'seen', 'drawn'
"""On the operator's side: the last segment that it is made of has arrived, its worker takes it, has decoded or
concealed it, has published it; a subscriber of the message has it, and one of its view."""

BUDGET: Sequence[Tuple[str, str, str]] = (
    ('source callback', STAMPED, RECEIVED), ('wait for the encoder', RECEIVED, STARTED), ('encode', STARTED, ENCODED),
    ('queue', ENCODED, FIRST_SENT), ('sending', FIRST_SENT, LAST_SENT), ('air', LAST_SENT, ARRIVED),
    ('reassembly', ARRIVED, TAKEN), ('decode, concealment', TAKEN, ASSEMBLED), ('publish', ASSEMBLED, PUBLISHED),
    ('subscriber', PUBLISHED, SEEN), ('age', STAMPED, SEEN), ('view', PUBLISHED, DRAWN),
    ('age of the view', STAMPED, DRAWN))
"""(stage, mark at its beginning, mark at its end)"""


class Mark(NamedTuple):
    """A message passes a point."""
    stream: str
    stamp: int
    """Stamp of the message [ns]."""
    point: str
    time: float
    """By the machine's steady clock [s]."""

    def line(self) -> str:
        """As it is written into a file."""
        return '%s\t%d\t%s\t%.6f\n' % self


class Sized(NamedTuple):
    """What decided the size of a message."""
    stream: str
    stamp: int
    """Stamp of the message [ns]."""
    time: float
    """When it was encoded, by the machine's steady clock [s]; the others as of streams.encoder.Sizing."""
    coding: str
    granted: float
    used: int
    bound: str
    error: float

    def line(self) -> str:
        """As it is written into a file; read_marks leaves it out."""
        return '%s\t%d\t%.6f\t%s\t%.0f\t%d\t%s\t%.3f\n' % self


def read_sizes(lines: Iterable[str]) -> Iterator[Sized]:
    """The lines of images' sizes in a file; others are left out."""
    for line in lines:
        fields = line.rstrip('\n').split('\t')
        if len(fields) == len(Sized._fields):
            stream, stamp, time, coding, granted, used, bound, error = fields
            yield Sized(stream, int(stamp), float(time), coding, float(granted), int(used), bound, float(error))


def read_marks(lines: Iterable[str]) -> Iterator[Mark]:
    """The marks of a file's lines; those that are none, as where a process was killed, are left out."""
    for line in lines:
        fields = line.rstrip('\n').split('\t')
        try:
            mark = Mark(fields[0], int(fields[1]), fields[2], float(fields[3]))
        except (ValueError, IndexError):
            continue
        if len(fields) == 4 and math.isfinite(mark.time):
            yield mark


class Stages:
    """Joins the marks of each message. Of several marks of a point the last one counts."""

    def __init__(self) -> None:
        self._passed: Dict[Tuple[str, int], Dict[str, float]] = {}

    def add(self, mark: Mark) -> None:
        """Take a mark; they come in any order."""
        self._passed.setdefault((mark.stream, mark.stamp), {})[mark.point] = mark.time

    def durations(self, stream: str, since: float = -math.inf, until: float = math.inf) -> Mapping[str, List[float]]:
        """How long messages were in each stage of BUDGET, of those that have both its marks [s].

        :param since, until: when they were stamped, or first seen, by the clock of the marks [s]
        """
        result: Dict[str, List[float]] = {stage: [] for stage, _, _ in BUDGET}
        for (name, _), passed in self._passed.items():
            if name != stream or not since <= min(passed.values()) < until:
                continue
            for stage, begin, end in BUDGET:
                if begin in passed and end in passed:
                    result[stage].append(passed[end] - passed[begin])
        return result
