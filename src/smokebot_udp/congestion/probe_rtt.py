# SPDX-License-Identifier: BSD-3-Clause
"""Pauses in which less is sent, to measure the path without a queue: its base delay.

A *dip* is short and is BBR's ProbeRTT. A *drain* is for a queue that has become long: it is longer and deeper, goes on
while the delay still falls, and takes the remaining delay for the path's.
"""
import math
from typing import Optional

from .delay import QueueDelay
from .feedback import PacketSample

DIP_DURATION = 0.2
"""[s]"""

DIP_GAIN = 0.5
"""Part of the capacity that may be sent in a dip."""

MAX_BASE_STEP = 0.004
"""A dip raises the base delay by this at most, and by what jitter may have made it short: clocks drift, and datagrams
take longer on slower air [s]."""

DRAIN_DURATION = 0.6
"""A drain ends after this long, or when the queue is gone [s],"""

DRAIN_GAIN = 0.25
"""Part of the capacity that may be sent in a drain."""

MIN_DRAIN_DURATION = 0.15
"""but not before this long [s]."""

DRAIN_EXTENSION = 0.25
"""It goes on for this long after a report whose delay has changed [s]: the path's own delay does not change,"""

SAME_DELAY = 0.005
"""where a difference up to this is no change [s],"""

MAX_DRAIN_DURATION = 3.0
"""but a drain is not extended after this long [s]."""


class ProbeRtt:
    """The dip or drain in progress, if any."""

    def __init__(self) -> None:
        self._began = self._ends = -math.inf
        self._draining = False
        self._least: Optional[PacketSample] = None      # of least delay among those sent in this pause

    def active(self, now: float) -> bool:
        """Whether less is to be sent now."""
        return now < self._ends

    def draining_since(self, now: float) -> Optional[float]:
        """When the drain in progress began [s]; None: there is none."""
        return self._began if self._draining and self.active(now) else None

    def cancel(self) -> None:
        """End a pause; what it measured does not count."""
        self._ends, self._least = -math.inf, None

    def gain(self, now: float) -> float:
        """Part of the capacity that may be sent now; infinite outside a pause."""
        if not self.active(now):
            return math.inf
        return DRAIN_GAIN if self._draining else DIP_GAIN

    def covers(self, sent: float) -> bool:
        """Whether a datagram sent at that time was sent in the last pause [s]."""
        return self._began <= sent < self._ends + 1e-9

    def begin(self, base_expired: bool, queue_long: bool, now: float) -> None:
        """Begin a pause where there is a reason for one.

        :param base_expired: whether nothing confirmed the base delay for long
        :param queue_long: whether the queue has been long
        :param now: by a steady clock [s]
        """
        if self.active(now) or self._least is not None:
            return
        if base_expired or queue_long:
            self._began, self._draining = now, queue_long
            self._ends = now + (DRAIN_DURATION if queue_long else DIP_DURATION)

    def on_sample(self, sample: PacketSample, queue: float, target: float, delay: QueueDelay, now: float) -> bool:
        """Take what a report shows during a pause, or just after it.

        :param sample: speaks for the report
        :param queue: its queueing delay [s]
        :param target: queueing delay to keep; below it a drain is done [s]
        :param delay: its base is corrected at the end of the pause
        :param now: by a steady clock [s]
        :return: whether the pause ended, with a measurement
        """
        if sample.sent >= self._began and (self.active(now) or self._least is not None):
            if self._draining:
                self._schedule_end(sample, queue, target, now)
            if self._least is None or sample.delay < self._least.delay:
                self._least = sample
        if self.active(now) or self._least is None:
            return False
        if self._draining:
            delay.set_base(self._least, now)        # what is left is the path
        else:
            delay.raise_base(self._least, MAX_BASE_STEP, now)
        self._least = None
        return True

    def _schedule_end(self, sample: PacketSample, queue: float, target: float, now: float) -> None:
        """Extend a drain while the delay changes; end it when the queue is gone."""
        elapsed = now - self._began
        changed = self._least is not None and abs(sample.delay - self._least.delay) > SAME_DELAY
        if changed and elapsed < MAX_DRAIN_DURATION:
            self._ends = max(self._ends, now + DRAIN_EXTENSION)
        if queue < target and elapsed > MIN_DRAIN_DURATION:
            self._ends = min(self._ends, now)
