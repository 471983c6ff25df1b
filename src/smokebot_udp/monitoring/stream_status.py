# SPDX-License-Identifier: BSD-3-Clause
"""The status of a stream and of its connections, from its stats over time."""
from typing import Collection, Dict, Iterable, List, Optional, Tuple

from ..image_error import ImageError
from .stats import ConnectionStats, StreamStats
from .status import ERROR, ROBOT, TO_ROBOT, WARN, Kind, Status, Verdict, by_reason, scaled
from .thresholds import Thresholds
from .windows import Rate, Samples, Silence

MAX_BUSY, MET = 0.9, 0.9
"""Where its coding takes this part of the time, the processor limits a stream: a single thread codes it. That suffices
where it is sent at this part of its maximum rate, or of the source's."""

MIN_MESSAGES = 20
"""The loss ratio of fewer messages in the window is not judged: it may be chance."""


class ConnectionMonitor:
    """Follows the counters of one connection."""

    def __init__(self) -> None:
        self.bytes, self.datagrams, self.kernel_drops, self.not_sent = Rate(), Rate(), Rate(), Rate()
        self.received, self.expected = Rate(), Rate()

    def read(self, stats: ConnectionStats, now: float) -> None:
        """Take the counters' readings at a time [s]."""
        self.bytes.read(stats.bytes, now)
        self.datagrams.read(stats.datagrams, now)
        self.kernel_drops.read(stats.kernel_drops, now)
        self.not_sent.read(sum(stats.failures.values()), now)
        if stats.received is not None and stats.lost is not None:
            self.received.read(stats.received, now)
            # `lost` falls when a message arrives late; only this sum never does
            self.expected.read(stats.received + stats.lost, now)

    def status(self, stream: str, stats: ConnectionStats, thresholds: Thresholds) -> Status:
        """The status of the connection of a stream, by the counters read last."""
        verdict = Verdict()
        loss = judge_connections(verdict, [self], thresholds)
        name = stats.name or stream
        return Status(Kind.CONNECTION, '%s, %s' % (name, stats.peer), verdict.level, str(verdict) or 'connected', {
            'stream': name, 'peer': stats.peer, 'address': '%s:%s' % tuple(stats.address[:2]),
            'datagrams': stats.datagrams, 'datagrams/s': self.datagrams.per_second, 'bytes/s': self.bytes.per_second,
            'lost': stats.lost, 'loss [%]': scaled(loss, 100), 'idle [s]': stats.idle,
            'kernel drops': stats.kernel_drops, 'receive buffer [byte]': stats.receive_buffer,
            'longest datagram [byte]': stats.max_datagram_size,
            **by_reason('dropped', stats.dropped), **by_reason('not sent', stats.failures)})


def judge_connections(verdict: Verdict, monitors: Collection[ConnectionMonitor],
                      thresholds: Thresholds) -> Optional[float]:
    """Add the problems of some connections, taken together, to a verdict.

    :return: their loss ratio, 0..1; None if no message was expected
    """
    expected = sum(monitor.expected.growth for monitor in monitors)
    lost = max(0, expected - sum(monitor.received.growth for monitor in monitors))
    loss = lost / expected if expected else None
    if expected >= MIN_MESSAGES:
        verdict.check(loss, thresholds.warn_loss, thresholds.error_loss, '%.0f %% lost', 100)
    for problem, count in (('dropped by the kernel', sum(monitor.kernel_drops.growth for monitor in monitors)),
                           ('not sent', sum(monitor.not_sent.growth for monitor in monitors))):
        if count:
            verdict.add(WARN, '%d datagrams %s' % (count, problem))
    return loss


class StreamMonitor:
    """Follows the stats of one stream on one side of the link.

    A stream that is not steady may be silent and old: only its connections and their loss are judged.

    :param side: ROBOT or OPERATOR
    :param name: of the stream
    :param topic: the source's topic (robot), or the topic on which the stream is published (operator)
    :param now: seconds of a monotonic clock, here and below
    """

    def __init__(self, side: str, name: str, topic: str, thresholds: Thresholds, now: float) -> None:
        self._side, self._name, self._topic, self._thresholds = side, name, topic, thresholds
        self._rate_in, self._rate_out, self._busy = Rate(), Rate(), Rate()
        self._silence_in, self._silence_out = Silence(now), Silence(now)
        self._ages, self._completeness, self._errors = Samples(), Samples(), Samples()
        self._last_error: Optional[ImageError] = None
        self._connections: Dict[Tuple[str, str, str], ConnectionMonitor] = {}    # by name, peer and address

    def update(self, stats: StreamStats, now: float, clock_offset: Optional[float] = 0.0) -> List[Status]:
        """Take the newest stats.

        :param clock_offset: the clock that stamps the messages minus this machine's [s]; None: unknown, and so are the
            messages' ages
        :return: the status of the stream, followed by one for each connection
        """
        self._rate_in.read(stats.messages_in, now)
        self._rate_out.read(stats.messages_out, now)
        self._busy.read(int(1e3 * stats.busy), now)
        self._silence_in.read(stats.messages_in, now)
        self._silence_out.read(stats.messages_out, now)
        for age, completeness, error in stats.shown:
            self._ages.add(None if age is None or clock_offset is None else age + clock_offset, now)
            self._completeness.add(completeness, now)
            self._errors.add(None if error is None else error.rms, now)
            self._last_error = error
        if not stats.enabled or (self._side == ROBOT and not stats.connections):
            self._silence_out.reset(now)
        connections = self._follow(stats.connections, now)
        return [self._status(stats, now)] + [
            monitor.status(self._name, connection, self._thresholds) for monitor, connection in connections]

    def waits_for_source(self, stats: StreamStats, now: float) -> bool:
        """Whether the source is silent although messages are expected, by the stats of the last `update`."""
        expected = stats.enabled and (stats.steady or not stats.messages_in)
        return expected and self._silence_in.too_long(now, self._silence_limit(stats)) is not None

    def _silence_limit(self, stats: StreamStats) -> float:
        return max(self._thresholds.error_silence, 3 / stats.rate if stats.rate else 0.0)

    def _follow(self, connections: Iterable[ConnectionStats],
                now: float) -> List[Tuple[ConnectionMonitor, ConnectionStats]]:
        """Read each connection's counters; monitors of connections that have ended are dropped."""
        found = {(connection.name, connection.peer, str(connection.address)): connection for connection in connections}
        self._connections = {key: self._connections.get(key) or ConnectionMonitor() for key in found}
        for key, monitor in self._connections.items():
            monitor.read(found[key], now)
        return [(monitor, found[key]) for key, monitor in self._connections.items()]

    def _status(self, stats: StreamStats, now: float) -> Status:
        age, completeness = self._ages.percentile(50, now), self._completeness.percentile(50, now)
        rms = self._errors.percentile(50, now)
        error = None if rms is None or self._last_error is None else self._last_error._replace(rms=rms)
        verdict = Verdict()
        if stats.enabled:
            self._judge_silence(verdict, stats, now)
            self._judge_speed(verdict, stats)
            self._judge_quality(verdict, age if stats.steady else None, completeness, error)
        if stats.problem:
            verdict.add(WARN, stats.problem)
        monitors = self._connections.values()
        loss = judge_connections(verdict, monitors, self._thresholds)
        return Status(Kind.STREAM, self._name, verdict.level, str(verdict) or ('fine' if stats.enabled else 'off'), {
            'stream': self._name, 'topic': self._topic,
            'direction': TO_ROBOT if stats.to_robot else None, 'activity': stats.activity or None,
            'rate in [Hz]': self._rate_in.per_second, 'rate out [Hz]': self._rate_out.per_second,
            'datagrams': _sum(connection.datagrams for connection in stats.connections),
            'lost': _sum(connection.lost for connection in stats.connections),
            'loss [%]': scaled(loss, 100), 'completeness [%]': scaled(completeness, 100),
            'error': None if error is None else str(error),
            'rms error': rms,
            'age p50 [ms]': scaled(age, 1e3), 'age p99 [ms]': scaled(self._ages.percentile(99, now), 1e3),
            'bytes/s': sum(monitor.bytes.per_second or 0.0 for monitor in monitors),
            'kernel drops': _sum(connection.kernel_drops for connection in stats.connections),
            **by_reason('dropped', stats.dropped)})

    def _judge_silence(self, verdict: Verdict, stats: StreamStats, now: float) -> None:
        limit = self._silence_limit(stats)
        silence_in, silence_out = self._silence_in.too_long(now, limit), self._silence_out.too_long(now, limit)
        if self._side == ROBOT:
            if stats.to_robot:
                return
            if not stats.connections:
                verdict.add(WARN, 'no subscriber')
            if stats.steady and silence_in is not None:
                verdict.add(ERROR, 'its source is silent for %.0f s' % silence_in)
            elif stats.steady and silence_out is not None:
                verdict.add(ERROR, 'nothing is sent for %.0f s' % silence_out)
        elif silence_out is not None:
            if not stats.connections:
                verdict.add(ERROR, stats.problem or 'no connection to the robot')
            elif stats.steady:
                verdict.add(ERROR, 'nothing is shown for %.0f s' % silence_out)

    def _judge_speed(self, verdict: Verdict, stats: StreamStats) -> None:
        """Say so where the processor limits the stream."""
        source, rate, busy = self._rate_in.per_second, self._rate_out.per_second, self._busy.per_second
        if not source or rate is None or busy is None or busy < 1e3 * MAX_BUSY:
            return
        if self._side != ROBOT or rate < MET * min(source, stats.rate or source):
            verdict.add(WARN, 'this computer manages no more than %.3g Hz of it: lower its rate or its size' % rate)

    def _judge_quality(self, verdict: Verdict, age: Optional[float], completeness: Optional[float],
                       error: Optional[ImageError]) -> None:
        limits = self._thresholds
        verdict.check(age, limits.warn_age, limits.error_age, '%.0f ms old', 1e3)
        if completeness is not None and completeness < limits.warn_completeness:
            verdict.add(WARN, 'only %.0f %% complete' % (100 * completeness))
        if error is None:
            return
        if error.peak is None:
            if error.rms > limits.warn_error:
                verdict.add(WARN, 'an error of ' + str(error))
        elif error.psnr(error.peak) < limits.warn_psnr:
            verdict.add(WARN, 'only ' + str(error))


def _sum(values: Iterable[Optional[int]]) -> Optional[int]:
    """The sum of the known values; None if none is known."""
    known = [value for value in values if value is not None]
    return sum(known) if known else None
