# SPDX-License-Identifier: BSD-3-Clause
"""Pauses in which less is sent, to learn what the path is like without a queue of one's own.

A *dip* is short and is BBR's ProbeRTT: it measures the base delay. A *drain* is for a queue that has become long: it is
deeper, goes on while the delay still falls, and takes the remaining delay for the path's. The *first* pause may be a
drain of a queue that was full when the first report came. It goes on while the least delay so far falls, too; where
several robots share the air, that would make all drains too long. A *check* is made beside a competitor, to see whether
it is still there (competition.py).
"""
import math
from typing import NamedTuple, Optional

from .delay import QueueDelay
from .feedback import PacketSample


class Kind(NamedTuple):
    """What a pause is like."""
    gain: float
    """Part of the rate that is sent meanwhile."""
    duration: float
    """It ends after this long [s]."""
    drains: bool = False
    """Whether it goes on while the delay changes, and what delay it leaves is the path's."""
    doubts: bool = False
    """Whether it goes on where the least delay so far falls, too."""


DIP, DRAIN, FIRST, CHECK = Kind(0.5, 0.2), Kind(0.25, 0.6, True), Kind(0.25, 0.6, True, True), Kind(0.6, 0.6)

MAX_BASE_STEP = 0.004
"""A dip raises the base delay by this at most, and by what jitter may have made it short: clocks drift, and datagrams
take longer on slower air [s]."""

MIN_DRAIN_DURATION = 0.15
"""A drain ends when the queue is gone, but not before this long [s]."""

DRAIN_EXTENSION = 0.25
"""A drain goes on for this long after a report whose delay has changed, as the path's own delay does not change [s]."""

SAME_DELAY = 0.005
"""Delays that differ by this at most count as unchanged [s]."""

MAX_DRAIN_DURATION = 3.0
"""A drain is not extended after this long [s]."""


class Pause:
    """The pause in progress, if any."""

    def __init__(self) -> None:
        self.kind = DIP
        """Kind of the last pause."""
        self._began = self._ends = -math.inf
        self._least: Optional[PacketSample] = None      # of least delay among those sent in this pause

    def active(self, now: float) -> bool:
        """Whether less is to be sent now."""
        return now < self._ends

    @property
    def ever(self) -> bool:
        """Whether there was one."""
        return self._began > -math.inf

    def gain(self, now: float) -> float:
        """Part of the rate that may be sent now."""
        return self.kind.gain if self.active(now) else 1.0

    def since(self, now: float) -> Optional[float]:
        """When a drain or a check in progress began [s]; None: there is none."""
        return self._began if self.kind is not DIP and self.active(now) else None

    def covers(self, sent: float) -> bool:
        """Whether a datagram sent at that time was sent in the last pause [s]."""
        return self._began <= sent < self._ends + 1e-9

    def begin(self, kind: Kind, now: float) -> None:
        """Begin a pause, unless one is in progress or waits for its measurement."""
        if not self.active(now) and self._least is None:
            self.kind, self._began, self._ends = kind, now, now + kind.duration

    def cancel(self) -> None:
        """End a pause; what it measured does not count."""
        self._ends, self._least = -math.inf, None

    def on_sample(self, sample: PacketSample, queue: float, target: float, delay: QueueDelay, now: float) -> None:
        """Take what a report shows during a dip or a drain, or just after it.

        :param sample: speaks for the report
        :param queue: its queueing delay [s]
        :param target: queueing delay to keep; below it a drain is done [s]
        :param delay: its base is corrected at the end of the pause
        :param now: by a steady clock [s]
        """
        if sample.sent >= self._began and (self.active(now) or self._least is not None):
            if self.kind.drains:
                self._schedule_end(sample, queue, target, delay, now)
            if self._least is None or sample.delay < self._least.delay:
                self._least = sample
        if self.active(now) or self._least is None:
            return
        if self.kind.drains:
            delay.set_base(self._least, now)        # what is left is the path
        else:
            delay.raise_base(self._least, MAX_BASE_STEP, now)
        self._least = None

    def _schedule_end(self, sample: PacketSample, queue: float, target: float, delay: QueueDelay, now: float) -> None:
        """Extend a drain while the delay changes; end it when the queue is gone, unless the base itself still falls."""
        elapsed = now - self._began
        changed = self._least is not None and abs(sample.delay - self._least.delay) > SAME_DELAY
        if changed and elapsed < MAX_DRAIN_DURATION:
            self._ends = max(self._ends, now + DRAIN_EXTENSION)
        falls = changed and self.kind.doubts and delay.base is sample
        if queue < target and elapsed > MIN_DRAIN_DURATION and not falls:
            self._ends = min(self._ends, now)
