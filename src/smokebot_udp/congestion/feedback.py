# SPDX-License-Identifier: BSD-3-Clause
"""Receiver reports: made on the receiver's side, checked on the sender's side before anything uses them.

A report lists datagrams that arrived and how long before the report that was (msg/LinkReport.msg; the idea is RFC
8888's). The sender knows when they were sent, how long they are and what was sent in between (sent_history.py).
Therefore

* nothing depends on synchronised clocks: all values are differences of one steady clock or the other;
* a lost report costs nothing: counters are totals, and each arrival is reported twice;
* the round trip is ``now - sent - age``, without an echo. The clock offset, for ages shown to people, comes from
  msg/ClockEcho.msg and is not used here;
* a forged report can at most pretend that everything that was sent arrived at once; max_rate holds all the same.
"""
import collections
import math
from dataclasses import dataclass, field
from typing import Any, Callable, Counter, Deque, Dict, List, NamedTuple, Optional, Tuple

from .sent_history import SEQ_MODULUS, SentHistory

SAMPLE_WINDOW = 0.2
"""A report has the arrivals of this long: twice the report interval, so that one report may be lost [s],"""

MIN_SAMPLES = 4
"""or this many, if older,"""

MAX_QUIET_AGE = 5.0
"""but none older than this [s]."""

SAMPLE_INTERVAL = 0.003
"""Arrival samples are at least this far apart [s]."""

MAX_SAMPLES = 64
"""Arrival samples in a report."""

MAX_STREAMS = 64
"""Streams in a report."""

MAX_AGE = 10.0
"""Older arrivals in a report are not believed [s]."""

RESTART_GAP = 4096
"""A sequence number this far behind the highest one shows that the sender restarted."""

CLOCK_TOLERANCE = 1.0
"""Both steady clocks may disagree by this about the time between two reports, which wait in queues [s]."""

CLOCK_CONFIRMATIONS = 3
"""After this many consecutive reports that agree with each other, but not with those before, the clock did jump."""


@dataclass
class StreamArrivals:
    """As msg/StreamArrivals.msg."""
    name: str
    highest: int = 0
    received: int = 0
    bytes: int = 0


@dataclass
class ArrivalSample:
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
    marks: List[ArrivalSample] = field(default_factory=list)


class ReceiveHistory:
    """The receiver's side: counts what arrives.

    :param new_session: f() -> a random number of 32 bits
    """

    def __init__(self, new_session: Callable[[], int]) -> None:
        self._new_session = new_session
        self._connections: Dict[str, int] = {}      # {stream: number of its newest connection}
        self.restart()

    def restart(self) -> None:
        """Begin a new session: the sender restarted."""
        self._session = self._new_session()
        self._streams: Dict[str, Tuple[int, StreamArrivals]] = {}      # {name: (index in a report, counters)}
        # (time of arrival, index of the stream, sequence number)
        self._samples: Deque[Tuple[float, int, int]] = collections.deque(maxlen=MAX_SAMPLES)

    def add(self, stream: str, seq: int, size: int, now: float, count: int = 1, connection: int = 0) -> None:
        """Record datagrams that arrived for the first time.

        :param stream: its name
        :param seq: the highest of their sequence numbers
        :param size: of all of them [byte]
        :param now: when, by a steady clock [s]
        :param count: number of datagrams
        :param connection: number of the connection that they came by. A newer one shows that the sender restarted and
            knows nothing of the past; what an older one still delivers is ignored
        """
        if connection > self._connections.setdefault(stream, connection):
            self._connections[stream] = connection
            self.restart()
        if connection < self._connections[stream]:
            return
        if self._samples and now < self._samples[-1][0] - CLOCK_TOLERANCE:
            self.restart()      # the clock is not steady
        if stream not in self._streams:
            if len(self._streams) == MAX_STREAMS:
                return
            self._streams[stream] = len(self._streams), StreamArrivals(stream, highest=seq)
        index, counters = self._streams[stream]
        if seq < counters.highest - RESTART_GAP:
            self.restart()
            self.add(stream, seq, size, now, count, connection)
            return
        counters.received += count
        counters.bytes += size
        if seq >= counters.highest:     # a reordered datagram says nothing about the queue now
            counters.highest = seq
            if not self._samples or now - self._samples[-1][0] >= SAMPLE_INTERVAL:
                self._samples.append((now, index, seq))

    def report(self, now: float) -> Report:
        """Make the report of this moment.

        :param now: by the same steady clock [s]
        """
        samples = [sample for sample in self._samples if 0 <= now - sample[0] <= SAMPLE_WINDOW]
        if len(samples) < MIN_SAMPLES:
            samples = [sample for sample in list(self._samples)[-MIN_SAMPLES:] if 0 <= now - sample[0] <= MAX_QUIET_AGE]
        marks = [ArrivalSample(index, seq, round(1e6 * (now - arrived))) for arrived, index, seq in samples]
        streams = [StreamArrivals(one.name, one.highest, one.received, one.bytes) for _, one in self._streams.values()]
        return Report(self._session, round(1e6 * now), streams, marks)


class PacketSample(NamedTuple):
    """A datagram whose times of sending and arrival are known."""
    sent: float
    """By the sender's clock [s]."""
    arrived: float
    """By the receiver's clock; only differences count [s]."""
    size: int
    """[byte]"""
    total: int
    """Bytes of all streams sent so far, this datagram included."""

    @property
    def delay(self) -> float:
        """One-way delay plus the unknown, constant clock offset [s]."""
        return self.arrived - self.sent


class Feedback(NamedTuple):
    """The news in a valid report."""
    samples: List[PacketSample]
    """Those not reported before, in sending order."""
    round_trip: float
    """The shortest of all samples in the report; NaN: it has none [s]."""
    expected: int
    """Datagrams that could have arrived since the last valid report."""
    received: int
    """Datagrams that did."""
    unreported: int
    """Bytes sent after the newest sample."""
    restarted: bool
    """Whether the receiver or its clock restarted: delays before and after are not comparable."""


class _InvalidReport(Exception):
    """Why a report is not believed."""


class FeedbackReader:
    """Checks reports of one receiver. Forged and impossible reports are dropped and counted; nothing is raised.

    :param history: what was sent
    """

    def __init__(self, history: SentHistory) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """Reports that were not believed, by reason."""
        self._history = history
        self._last: Optional[Any] = None    # the last valid report
        self._last_read = -math.inf         # when it came, by our clock [s]
        self._newest = 0                    # total of the newest sample
        self._jumps: List[Tuple[int, float]] = []   # (report's clock [us], when it came [s]) that contradict _last

    def read(self, report: Any, now: float) -> Optional[Feedback]:
        """Read a report.

        :param report: a Report or a LinkReport message
        :param now: by the sender's steady clock [s]
        :return: None: it is not believed
        """
        try:
            _check_form(report)
            samples = self._samples(report, now)
            before = self._check_counters(report)
            restarted = self._check_clock(report, now)
        except _InvalidReport as invalid:
            self.dropped[str(invalid)] += 1
            return None
        expected, received = _difference(report, {} if restarted else before)
        self._last, self._last_read = report, now
        if restarted:
            self._newest = 0
        fresh = sorted((sample for sample, _ in samples if sample.total > self._newest),
                       key=lambda sample: sample.total)
        self._newest = fresh[-1].total if fresh else self._newest
        round_trip = min((now - sample.sent - age for sample, age in samples), default=math.nan)
        return Feedback(fresh, round_trip, expected, received, self._history.total - self._newest, restarted)

    def _samples(self, report: Any, now: float) -> List[Tuple[PacketSample, float]]:
        """[(sample, its age at the time of the report [s]), ...]"""
        samples, made = [], 1e-6 * report.clock
        for mark in report.marks:
            if mark.stream >= len(report.streams):
                raise _InvalidReport('no such stream')
            packet = self._history.find(report.streams[mark.stream].name, mark.seq)
            if packet is None:
                raise _InvalidReport('never sent')
            age = 1e-6 * mark.age
            if age > MAX_AGE or now - packet.sent < age:
                raise _InvalidReport('arrived before it was sent')
            samples.append((PacketSample(packet.sent, made - age, packet.size, packet.total), age))
        return samples

    def _check_counters(self, report: Any) -> Dict[str, Any]:
        """{stream: its counters in the last report of this session}"""
        same_session = self._last is not None and self._last.session == report.session
        before = {one.name: one for one in self._last.streams} if self._last is not None and same_session else {}
        for one in report.streams:
            count, size = self._history.totals(one.name)
            if one.received > count or one.bytes > size:
                raise _InvalidReport('received more than sent')
            known = before.get(one.name)
            if known is not None and (one.received < known.received or one.bytes < known.bytes
                                      or (one.highest - known.highest) % SEQ_MODULUS >= SEQ_MODULUS // 2):
                raise _InvalidReport('counters go backwards')
        return before

    def _check_clock(self, report: Any, now: float) -> bool:
        """Whether the receiver's clock started again."""
        reading = report.clock, now
        if self._last is None or self._last.session != report.session:
            self._jumps = []
            return True
        if not _contradict((self._last.clock, self._last_read), reading):
            self._jumps = []
            return False
        if self._jumps and _contradict(self._jumps[-1], reading):
            self._jumps = []
        self._jumps.append(reading)
        if len(self._jumps) < CLOCK_CONFIRMATIONS:
            raise _InvalidReport('clock jumps')
        self._jumps = []
        return True


def _difference(report: Any, before: Dict[str, Any]) -> Tuple[int, int]:
    """(expected, received) datagrams since the last report."""
    expected = received = 0
    for one in report.streams:
        if one.name in before:
            could = (one.highest - before[one.name].highest) % SEQ_MODULUS
            expected += could
            received += min(could, one.received - before[one.name].received)
    return expected, received


def _check_form(report: Any) -> None:
    """Check for what the message's types allow: a Report from elsewhere may hold a NaN."""
    if len(report.streams) > MAX_STREAMS or len(report.marks) > MAX_SAMPLES:
        raise _InvalidReport('too long')
    numbers = [report.session, report.clock]
    for one in report.streams:
        numbers += one.highest, one.received, one.bytes
    for mark in report.marks:
        numbers += mark.stream, mark.seq, mark.age
    if not all(isinstance(number, int) and 0 <= number < 1 << 64 for number in numbers):
        raise _InvalidReport('not unsigned integers')


def _contradict(earlier: Tuple[int, float], later: Tuple[int, float]) -> bool:
    """Whether two steady clocks cannot give both of these readings: (report's clock [us], when it came [s])."""
    passed = 1e-6 * (later[0] - earlier[0])
    return passed <= 0 or abs(passed - (later[1] - earlier[1])) > CLOCK_TOLERANCE
