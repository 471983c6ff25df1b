# SPDX-License-Identifier: BSD-3-Clause
"""Receiver reports: made on the receiver's side, checked on the sender's side before anything uses them.

A report lists datagrams that arrived and how long before the report that was (msg/LinkReport.msg; the idea is RFC
8888's). The sender knows when they were sent, how long they are and what was sent in between (sent_history.py).
Therefore

* nothing depends on synchronised clocks: all values are differences of one steady clock or the other;
* a lost report costs nothing: counters are totals, and each arrival is reported twice;
* the round trip is ``now - sent - age``, without an echo. The clock offset, for ages shown to people, comes from
  msg/ClockEcho.msg and is not used here;
* a forged report can at most pretend that everything that was sent arrived at once, and max_rate holds all the same; or
  that the link is slow, as a link may be. It cannot name a datagram again that was news before.

What is impossible in a report is left out, and the rest is used: a datagram can be reported before it is recorded as
sent, and counters of a stream can survive the sender's restart. A report without anything possible is dropped.
"""
import collections
import math
from dataclasses import dataclass, field
from typing import Any, Callable, Counter, Deque, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from .operator_share import OperatorHistory
from .sent_history import SEQ_MODULUS, SentHistory

SAMPLE_WINDOW = 0.2
"""A report has the arrivals of this long: twice the report interval, so that one report may be lost [s]."""

MIN_SAMPLES = 4
"""A report has at least this many arrivals, even if some are older than SAMPLE_WINDOW."""

MAX_QUIET_AGE = 5.0
"""A report has no arrivals older than this [s]."""

SAMPLE_INTERVAL = 0.003
"""Arrival samples are at least this far apart [s]."""

MAX_SAMPLES = 64
"""Arrival samples in a report."""

MAX_STREAMS = 64
"""Streams in a report."""

REPORTED_FOR = 1.0
"""Counters that no longer change are reported for this long, in ten reports, which are not all lost. They are reported
again when the stream is heard again [s]."""

STREAM_TIMEOUT = 10.0
"""After a silence of this long, any step back of a stream's sequence numbers shows that the sender restarted [s]."""

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
    marked: int = 0


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
        self._marked = 0
        self._streams: Dict[str, StreamArrivals] = {}
        self._heard: Dict[str, float] = {}          # {stream: newest time of arrival [s]}
        # (time of arrival, stream, sequence number)
        self._samples: Deque[Tuple[float, str, int]] = collections.deque(maxlen=MAX_SAMPLES)

    def add(self, stream: str, seq: int, size: int, now: float, count: int = 1, connection: int = 0,
            marked: int = 0) -> None:
        """Record datagrams that arrived for the first time.

        :param stream: its name
        :param seq: the highest of their sequence numbers
        :param size: of all of them [byte]
        :param now: when, by a steady clock [s]
        :param count: number of datagrams
        :param connection: number of the connection that they came by. A newer one shows that the sender restarted and
            knows nothing of the past; what an older one still delivers is ignored
        :param marked: how many of them were marked by a congested queue (ECN)
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
            self._streams[stream] = StreamArrivals(stream, highest=seq)
        counters = self._streams[stream]
        silence = now - self._heard.get(stream, now)
        if seq < counters.highest - (RESTART_GAP if silence <= STREAM_TIMEOUT else 0):
            self.restart()
            self.add(stream, seq, size, now, count, connection, marked)
            return
        self._heard[stream] = max(now, self._heard.get(stream, now))
        counters.received += count
        counters.bytes += size
        self._marked += marked
        if seq >= counters.highest:     # a reordered datagram says nothing about the queue now
            counters.highest = seq
            if not self._samples or now - self._samples[-1][0] >= SAMPLE_INTERVAL:
                self._samples.append((now, stream, seq))

    def report(self, now: float) -> Report:
        """Make the report of this moment.

        :param now: by the same steady clock [s]
        """
        samples = [sample for sample in self._samples if 0 <= now - sample[0] <= SAMPLE_WINDOW]
        if len(samples) < MIN_SAMPLES:
            samples = [sample for sample in list(self._samples)[-MIN_SAMPLES:] if 0 <= now - sample[0] <= MAX_QUIET_AGE]
        sampled = {name for _, name, _ in samples}
        reported = [one for one in self._streams.values()
                    if now - self._heard[one.name] <= REPORTED_FOR or one.name in sampled]
        index = {one.name: number for number, one in enumerate(reported)}
        marks = [ArrivalSample(index[name], seq, round(1e6 * (now - arrived))) for arrived, name, seq in samples]
        streams = [StreamArrivals(one.name, one.highest, one.received, one.bytes) for one in reported]
        return Report(self._session, round(1e6 * now), streams, marks, self._marked)


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
    together: int = 0
    """Bytes that were sent at the same time, up to this datagram; 0: only this one [byte]."""

    @property
    def delay(self) -> float:
        """One-way delay plus the unknown, constant clock offset [s]."""
        return self.arrived - self.sent


def sending_rate(first: PacketSample, last: PacketSample) -> float:
    """At what rate was sent what is between two samples [byte/s]."""
    return (last.total - first.total) / max(last.sent - first.sent, 1e-3)


class Arrivals(NamedTuple):
    """Datagrams of one stream between two reports."""
    stream: str
    """As the report names it."""
    expected: int
    """Those sent, to anybody: for this receiver some may have been left out on purpose."""
    received: int


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
    arrivals: Sequence[Arrivals] = ()
    """Arrivals of each stream in the report."""
    marked: int = 0
    """Datagrams that arrived since the last valid report with the mark of a congested queue (ECN, RFC 3168)."""

    @property
    def lost(self) -> int:
        """The expected datagrams that did not arrive."""
        return self.expected - self.received

    @property
    def loss(self) -> float:
        """Their ratio; 0: none was expected."""
        return self.lost / max(self.expected, 1)


class _InvalidReport(Exception):
    """Why a report is not believed."""


class FeedbackReader:
    """Checks reports of one receiver. What is impossible is left out and counted; nothing is raised.

    :param history: what was sent to all receivers
    """

    def __init__(self, history: SentHistory) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """Reports that were not believed, wholly or in part, by reason."""
        self.sent = OperatorHistory(history)
        """What the receiver was sent."""
        self.is_shared = False
        """Whether what is left out of a stream may have gone to the receiver by another path."""
        self._last: Any = None              # the last valid report; None: there was none
        self._counters: Dict[str, Any] = {}     # {stream: its last possible counters of this session}
        self._last_read = -math.inf         # when it came, by our clock [s]
        self._newest = 0                    # total of the newest sample
        self._jumps: List[Tuple[int, float]] = []   # (report's clock [us], when it came [s]) that contradict _last

    def read(self, report: Any, now: float) -> Optional[Feedback]:
        """Read a report.

        :param report: a Report or a LinkReport message
        :param now: by the sender's steady clock [s]
        :return: None: it is not believed
        """
        impossible: Set[str] = set()
        try:
            _check_form(report)
            samples = self._samples(report, now, impossible)
            before, counters = self._possible_counters(report, impossible)
            restarted = self._check_clock(report, now)
        except _InvalidReport as invalid:
            impossible.add(str(invalid))
            return None
        finally:
            self.dropped.update(impossible)
        known = {} if restarted else before
        expected, received = self._difference(counters, known)
        arrivals = self._arrivals(counters, known)
        marked = 0 if restarted else self._marked(report.marked - self._last.marked, counters, known)
        self._last, self._last_read = report, now
        self._counters = {**before, **counters}     # only of streams that exist
        # a datagram is news once: even after a restart of the receiver, older ones can no longer arrive
        news = {sample.total: sample for sample, _ in samples if sample.total > self._newest}
        fresh = [news[total] for total in sorted(news)]
        self._newest = fresh[-1].total if fresh else self._newest
        round_trip = min((now - sample.sent - age for sample, age in samples), default=math.nan)
        return Feedback(fresh, round_trip, expected, received, self.sent.total - self._newest, restarted,
                        arrivals, marked)

    def _samples(self, report: Any, now: float, impossible: Set[str]) -> List[Tuple[PacketSample, float]]:
        """[(possible sample, its age at the time of the report [s]), ...]

        :param impossible: reasons of others are added
        """
        samples, made = [], 1e-6 * report.clock
        for mark in report.marks:
            if mark.stream >= len(report.streams):
                raise _InvalidReport('no such stream')
            packet, age = self.sent.find(report.streams[mark.stream].name, mark.seq), 1e-6 * mark.age
            if packet is None:
                impossible.add('never sent')
            elif age > MAX_AGE or now - packet.sent < age:
                impossible.add('arrived before it was sent')
            else:
                samples.append((PacketSample(packet.sent, made - age, *packet[1:]), age))
        if report.marks and not samples:
            raise _InvalidReport(impossible.pop())
        return samples

    def _possible_counters(self, report: Any, impossible: Set[str]) -> Tuple[Dict[str, Any], Dict[str, Any]]:
        """({stream: its last counters in this session}, {stream: its counters now}), those that are possible.

        :param impossible: reasons of others are added
        """
        same_session = self._last is not None and self._last.session == report.session
        before, counters = self._counters if same_session else {}, {}
        if self._last is not None and same_session and report.marked < self._last.marked:
            raise _InvalidReport('counters go backwards')
        for one in report.streams:
            count, size = self.sent.totals(one.name)
            known = before.get(one.name)
            if one.received > count or one.bytes > size:
                impossible.add('received more than sent')
            elif not self.sent.reached(one.name, one.highest):
                impossible.add('never sent')
            elif known is not None and (one.received < known.received or one.bytes < known.bytes
                                        or (one.highest - known.highest) % SEQ_MODULUS >= SEQ_MODULUS // 2):
                raise _InvalidReport('counters go backwards')
            else:
                counters[one.name] = one
        if report.streams and not counters:
            raise _InvalidReport(impossible.pop())
        return before, counters

    def _difference(self, counters: Dict[str, Any], before: Dict[str, Any]) -> Tuple[int, int]:
        """(expected, received) datagrams since the last report."""
        expected = received = 0
        for name, one in counters.items():
            if name in before:
                could = self.sent.sent_between(name, before[name].highest, one.highest)
                expected += could
                received += min(could, one.received - before[name].received)
        return expected, received

    def _arrivals(self, counters: Mapping[str, Any], before: Mapping[str, Any]) -> List[Arrivals]:
        found = []
        for name, one in counters.items():
            last = before.get(name, one)
            expected = (self.sent.sent_between(name, last.highest, one.highest) if self.is_shared else
                        (one.highest - last.highest) % SEQ_MODULUS)
            found.append(Arrivals(name, expected, min(expected, one.received - last.received)))
        return found

    def _marked(self, reported: int, counters: Mapping[str, Any], before: Mapping[str, Any]) -> int:
        """The datagrams marked since the last report: no more than arrived meanwhile."""
        arrived: int = sum(one.received - (before[name].received if name in before else 0)
                           for name, one in counters.items())
        if reported > arrived:
            self.dropped['more marked than received'] += 1
        return min(reported, arrived)

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


def _check_form(report: Any) -> None:
    """Check for what the message's types allow: a Report from elsewhere may hold a NaN."""
    if len(report.streams) > MAX_STREAMS or len(report.marks) > MAX_SAMPLES:
        raise _InvalidReport('too long')
    numbers = [report.session, report.clock, report.marked]
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
