# SPDX-License-Identifier: BSD-3-Clause
"""Reports of what arrived: made on the receiver's side, and checked on the sender's before anything believes them.

A report tells which datagrams came and how long before the report was made (msg/LinkReport.msg). When they left, how
long they are and what left between them the sender knows itself (departures.py). So

* nothing rests on the machines' clocks: all is differences of one steady clock or the other;
* a lost report costs nothing, for counts are totals and marks are told twice;
* the round trip is `now - sent - age`, with no echo of its own. The clocks' offset, for ages that people read, stays
  with msg/ClockEcho.msg and clock.py: once a second is enough for it, and it has nothing to do with the rate;
* a forged report can at the utmost make believe that all that left came, and at once; max_rate holds whatever it says.
"""
import collections
import math
from dataclasses import dataclass, field
from typing import List, NamedTuple

from .sent_history import NUMBERS

SPAN = 0.2
"""Marks of so long go into a report: twice the period, so that one report may be lost [s]."""

FEWEST = 4
"""Or so many, though they are older."""

APART = 0.003
"""Marks are so far apart at least [s]."""

MOST_MARKS = 64
MOST_STREAMS = 64
LONGEST = 10.0
"""Older marks tell nothing [s]."""

LATE = 4096
"""A number so far behind the highest is of another counting: the sender began anew."""

CLOCK_SLACK = 1.0
"""Both sides' steady clocks may disagree by so much about the time between two reports, which wait in queues [s]."""

CONFIRMED = 3
"""So many reports in a row that contradict what was before, but not one another, are right."""


@dataclass
class StreamArrivals:
    """As msg/StreamArrivals.msg."""
    name: str
    highest: int = 0
    received: int = 0
    bytes: int = 0


@dataclass
class ArrivalMark:
    """As msg/ArrivalMark.msg."""
    stream: int
    seq: int
    age: int


@dataclass
class Report:
    """As msg/LinkReport.msg."""
    session: int
    clock: int
    streams: List[StreamArrivals] = field(default_factory=list)
    marks: List[ArrivalMark] = field(default_factory=list)


class Arrivals:
    """The receiver's side: counts what arrives.

    :param session: f() -> a random number of 32 bits
    """

    def __init__(self, session):
        self._new_session = session
        self.begin()

    def begin(self):
        """All is counted anew: who sends began anew."""
        self._session = self._new_session()
        self._streams = {}                                  # {name: (index, StreamArrivals)}
        self._marks = collections.deque(maxlen=MOST_MARKS)  # (when, index, seq)

    def note(self, stream, seq, size, now, count=1):
        """Datagrams came that did not come before.

        :param stream: its name
        :param seq: the highest of their numbers
        :param size: of all of them [byte]
        :param now: when, by a steady clock [s]
        """
        if self._marks and now < self._marks[-1][0] - CLOCK_SLACK:
            self.begin()       # the clock is not as steady as it should be
        if stream not in self._streams:
            if len(self._streams) == MOST_STREAMS:
                return
            self._streams[stream] = len(self._streams), StreamArrivals(stream, highest=seq)
        index, known = self._streams[stream]
        if seq < known.highest - LATE:
            self.begin()
            self.note(stream, seq, size, now, count)
            return
        known.received += count
        known.bytes += size
        if seq >= known.highest:    # a late one tells nothing of the queue now
            known.highest = seq
            if not self._marks or now - self._marks[-1][0] >= APART:
                self._marks.append((now, index, seq))

    def report(self, now):
        """The Report as it is now."""
        told = [mark for mark in self._marks if 0 <= now - mark[0] <= SPAN]
        if len(told) < FEWEST:      # where hardly anything comes, the last that did
            told = [mark for mark in list(self._marks)[-FEWEST:] if 0 <= now - mark[0] <= LONGEST / 2]
        marks = [ArrivalMark(index, seq, round(1e6 * (now - when))) for when, index, seq in told]
        streams = [StreamArrivals(one.name, one.highest, one.received, one.bytes) for _, one in self._streams.values()]
        return Report(self._session, round(1e6 * now), streams, marks)


class Point(NamedTuple):
    """A datagram whose way is known."""
    sent: float
    """By the sender's clock [s]."""
    arrived: float
    """By the receiver's: differences count [s]."""
    size: int
    """[byte]"""
    total: int
    """Bytes that had left with it."""

    @property
    def delay(self):
        """One way, but for a constant [s]."""
        return self.arrived - self.sent


class Evidence(NamedTuple):
    """What a good report says that was not known before."""
    points: List[Point]
    """In the order they left."""
    round_trip: float
    """The least of the points'; NaN without one [s]."""
    expected: int
    """Datagrams that could have come since the last good report,"""
    received: int
    """and those that did."""
    unreported: int
    """Bytes that left after the newest point known."""
    anew: bool
    """Whether the receiver began anew: delays before and after are of different clocks."""


class _Impossible(Exception):
    """Why a report is not believed."""


class Reports:
    """Takes reports; what is forged or impossible is dropped and counted, and nothing is raised.

    :param departures: a Departures
    """

    def __init__(self, departures):
        self.dropped = collections.Counter()
        """Reports that were not believed, by reason."""
        self.loss = {}
        """{stream: share lost between the last two good reports}"""
        self._departures = departures
        self._last = None           # the last good report
        self._came = -math.inf      # when, by our clock [s]
        self._newest = 0            # total of the newest point
        self._contradicting = []    # (its clock [us], when it came [s])

    def take(self, report, now):
        """Take a report.

        :param report: a Report, or a LinkReport message
        :param now: by the sender's steady clock [s]
        :return: Evidence; None where it is not believed
        """
        try:
            _check_form(report)
            points = self._points(report, now)
            before = self._counts(report)
            anew = self._check_time(report, now)
        except _Impossible as impossible:
            self.dropped[str(impossible)] += 1
            return None
        expected, received = self._difference(report, {} if anew else before)
        self._last, self._came = report, now
        if anew:
            self._newest = 0
        fresh = sorted((point for point, _ in points if point.total > self._newest), key=lambda point: point.total)
        self._newest = fresh[-1].total if fresh else self._newest
        return Evidence(fresh, min((now - point.sent - age for point, age in points), default=math.nan),
                        expected, received, self._departures.total - self._newest, anew)

    def _points(self, report, now):
        """[(Point, age), ...] of the marks."""
        points, made = [], 1e-6 * report.clock
        for mark in report.marks:
            if mark.stream >= len(report.streams):
                raise _Impossible('no such stream')
            left = self._departures.find(report.streams[mark.stream].name, mark.seq)
            if left is None:
                raise _Impossible('never sent')
            age = 1e-6 * mark.age
            if age > LONGEST or now - left.sent < age:
                raise _Impossible('came before it left')
            points.append((Point(left.sent, made - age, left.size, left.total), age))
        return points

    def _counts(self, report):
        """{stream: what the last report of the session says of it}."""
        same = self._last is not None and self._last.session == report.session
        before = {one.name: one for one in self._last.streams} if same else {}
        for one in report.streams:
            count, size = self._departures.sent(one.name)
            if one.received > count or one.bytes > size:
                raise _Impossible('received more than sent')
            known = before.get(one.name)
            if known is not None and (one.received < known.received or one.bytes < known.bytes
                                      or (one.highest - known.highest) % NUMBERS >= NUMBERS // 2):
                raise _Impossible('counts go backwards')
        return before

    def _check_time(self, report, now):
        """Whether the receiver's clock began anew."""
        if self._last is None or self._last.session != report.session:
            self._contradicting = []
            return True
        if not _contradict((self._last.clock, self._came), (report.clock, now)):
            self._contradicting = []
            return False
        if self._contradicting and _contradict(self._contradicting[-1], (report.clock, now)):
            self._contradicting = []
        self._contradicting.append((report.clock, now))
        if len(self._contradicting) < CONFIRMED:
            raise _Impossible('time')
        self._contradicting = []
        return True

    def _difference(self, report, before):
        """(expected, received) datagrams since the last report."""
        self.loss, expected, received = {}, 0, 0
        for one in report.streams:
            if one.name in before:
                could = (one.highest - before[one.name].highest) % NUMBERS
                came = min(could, one.received - before[one.name].received)
                self.loss[one.name] = 1 - came / could if could else 0.0
                expected, received = expected + could, received + came
        return expected, received


def _check_form(report):
    """That it consists of what the message's types allow: who reads it from elsewhere may bring a NaN."""
    if len(report.streams) > MOST_STREAMS or len(report.marks) > MOST_MARKS:
        raise _Impossible('too long')
    numbers = [report.session, report.clock]
    for one in report.streams:
        numbers += one.highest, one.received, one.bytes
    for mark in report.marks:
        numbers += mark.stream, mark.seq, mark.age
    if not all(isinstance(number, int) and 0 <= number < 1 << 64 for number in numbers):
        raise _Impossible('no numbers')


def _contradict(earlier, later):
    """Whether two clocks that run steadily make no such pair of (report's clock [us], when it came [s])."""
    passed = 1e-6 * (later[0] - earlier[0])
    return passed <= 0 or abs(passed - (later[1] - earlier[1])) > CLOCK_SLACK
