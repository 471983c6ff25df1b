# SPDX-License-Identifier: BSD-3-Clause
"""Packet trains that probe for more capacity: datagrams that are due anyway, sent faster; padding is never sent.

After GCC's probe clusters (draft-ietf-rmcat-gcc-02) and packet dispersion (Dovrolis et al., 2001).
"""
import math
from typing import NamedTuple, Optional

from .feedback import PacketSample

DURATION = 0.025
"""A train takes this long at the known capacity [s]."""

MIN_PACKETS = 3
"""Datagrams in a train, at least: two intervals."""

FIRST_GAIN = 2.0
"""Rate of a first train, in known capacities;"""

NEXT_GAIN = 4.0
"""that of a train after a successful one."""

SUCCESS_FACTOR = 1.3
"""A train was successful where the queue was empty when it left, and the known capacity has grown by this factor since
then."""

RETRY_INTERVAL = 1.0
"""After an unsuccessful train the next one waits this long [s],"""

MAX_RETRY_INTERVAL = 30.0
"""and up to this twice as long each time where streams only wish for more: trains cost a few ms of queue, unless too
little is due for them [s],"""

QUEUED_RETRY_INTERVAL = 2.0
"""and this much longer while the queue looks occupied: its delay may be mistaken [s]."""

TIMEOUT = 0.5
"""A train that has not been reported after this long is lost [s]."""


class ProbeTrain(NamedTuple):
    """Datagrams that are due anyway leave faster."""
    rate: float
    """[byte/s]"""
    size: float
    """How much of them [byte]."""


class _Pending(NamedTuple):
    """A train that was not reported yet."""
    end: float
    """Bytes of all streams sent, the train included."""
    capacity: float
    """Known when it left [byte/s]."""
    empty: bool
    """Whether the queue was, then. Otherwise others may have paused when it arrived."""
    sent: float


class ProbeController:
    """Decides when a train leaves: one at a time, while the queue is empty and the streams want more."""

    def __init__(self) -> None:
        self._succeeded = False
        self._next = -math.inf      # not before [s]
        self._interval = RETRY_INTERVAL     # after the next unsuccessful train [s]
        self._wished = -math.inf    # where streams only wish for more: not before [s]
        self._pending: Optional[_Pending] = None

    def retry(self) -> None:
        """Wait no longer after an unsuccessful train."""
        self._next = self._wished = -math.inf
        self._interval = RETRY_INTERVAL

    def next(self, capacity: float, empty: bool, wanted: bool, newest: PacketSample, unreported: int,
             now: float, wished: bool = False) -> Optional[ProbeTrain]:
        """The train that leaves now, if any.

        :param capacity: as known [byte/s]
        :param empty: whether the queue is
        :param wanted: whether the streams would send more than they may
        :param newest: sample of the newest datagram that arrived
        :param unreported: bytes sent since
        :param now: by a steady clock [s]
        :param wished: whether what they send would be fresher if the link had more
        """
        if self._pending:
            complete = newest.total >= self._pending.end
            if not complete and now - self._pending.sent < TIMEOUT:
                return None
            self._succeeded = self._pending.empty and capacity > SUCCESS_FACTOR * self._pending.capacity
            self._pending = None
            if not self._succeeded:
                self._next, self._wished = now + RETRY_INTERVAL, now + self._interval
            if self._succeeded:
                self._interval = RETRY_INTERVAL
            elif complete:
                self._interval = min(2 * self._interval, MAX_RETRY_INTERVAL)
        least, usual = MIN_PACKETS * newest.size, capacity * DURATION
        if not (wanted or wished and now >= self._wished) or now < self._next:
            return None
        if not empty and (usual < least or now < self._next + QUEUED_RETRY_INTERVAL):
            return None
        train = ProbeTrain(capacity * (NEXT_GAIN if self._succeeded else FIRST_GAIN), max(least, usual))
        self._pending = _Pending(newest.total + unreported + train.size, capacity, empty, now)
        return train
