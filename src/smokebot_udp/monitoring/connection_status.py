# SPDX-License-Identifier: BSD-3-Clause
"""The status of a UDPROS connection, from its counters over time."""
from typing import Collection, Optional

from .stats import ConnectionStats
from .status import WARN, Kind, Status, Verdict, by_reason, scaled
from .thresholds import Thresholds
from .windows import Rate

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
