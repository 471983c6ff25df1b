# SPDX-License-Identifier: BSD-3-Clause
"""Packet trains: datagrams that are due anyway, sent faster, show what the path carries; padding is never sent.

After GCC's probe clusters (draft-ietf-rmcat-gcc-02) and packet dispersion (Dovrolis et al., 2001). A train exceeds the
tokens of a shaper, as otherwise it shows the line's speed (shaper.py). Where streams have less to send than a train
takes, they are planned for more as long as it leaves.
"""
import math
from typing import NamedTuple, Optional, Tuple

from .feedback import PacketSample
from .path import Observation

DURATION = 0.025
"""What a train has beyond the tokens takes this long at the known capacity, or longer where delays are noisy [s]."""

MIN_PACKETS = 3
"""Datagrams in a train, at least: two intervals."""

FIRST_GAIN, NEXT_GAIN = 2.0, 4.0
"""Rate of a first train, in known capacities; that of a train after a successful one, and of a long one that exceeds
the tokens of a shaper."""

EXCESS = 1.2
"""A train exceeds a shaper's tokens by this factor."""

BEYOND, BEYOND_NOISE = 0.02, 4.0
"""The same for a train that has the tokens and this in one message: this long at the known capacity, and this multiple
of what noise adds to delays. Another train takes this multiple itself. Beside 10 ms of noise a bucket of 6 kB hid for
15 s that 0.3 Mbit/s had become 1 where it was 50 ms in all, and each train delayed an image by 100 ms where it was 80.
Without a bucket, beside 4 ms of noise, it took 4 to 6 s until 0.3 Mbit/s that had become 20 were known, where trains
took 12 ms and were repeated after RETRY_INTERVAL at the earliest; now it takes 2 s (experiments adaptation) [s, 1]."""

AT_ONCE = 16.0
"""Rate of a train that has a shaper's tokens and what is beyond them in one message, in known capacities."""

GROWTH = 1.25
"""A longer train, which tokens come back beside, shows a capacity that is larger by this factor."""

DUE_TIME = 0.1
"""Streams have as much to send at once as they are planned for in this time [s]."""

MAX_PLANNED, REACHED = 3.0, 0.8
"""For a train, streams are planned for this multiple at most, and send this part of that multiple of the capacity at
least."""

FILLED = 0.95
"""A message that is made for a train fills this part of it (image_size.FILL), so that it leaves with it as a whole."""

SUCCESS_FACTOR = 1.3
"""A train was successful where the queue was empty when it left, and the known capacity has grown by this factor since
then."""

MAX_STEP, MAX_LASTING_STEP, LASTING = 2.0, 1.4, 0.2
"""Behind a token bucket a train shows a capacity that is larger by this factor at most: where the bucket is deeper than
is known, more would become a queue of several images. The lower factor is that of a bucket that takes longer than
LASTING to fill. `bench live` (loss 0 %): with 1.4, from 0.5 to 3 Mbit/s behind 6 kB takes 4 s, with 2.0 0.4 s; with 2.0
at 0.3 Mbit/s behind 32 kB the longest freeze is 0.56 s, with 1.4 0.26 s [1, 1, s]."""

RETRY_INTERVAL = 0.8
"""Time from an unsuccessful train to the next one [s]."""

CLEAR_RETRY_INTERVAL = 0.3
"""Time from an unsuccessful train to the next one where it left no queue, or behind a shaper that is sure caused none.
It cost nothing, and too much of it was lost, or too little was due, to show a rate. 0 missed two bounds of
test_simulated_air.py by a little, 0.3 none [s]."""

REFILL_INTERVALS = 4.0
"""Behind a shaper, the next train after an unsuccessful one also waits this many times as long as the shaper's tokens
take at the capacity. Mostly there are some tokens then."""

MAX_RETRY_INTERVAL = 30.0
"""Longest time from an unsuccessful train to the next one where streams only wish for more. The time doubles with each
unsuccessful train, as trains cost a few ms of queue, unless too little was due for it [s]."""

QUEUED_RETRY_INTERVAL = 2.0
"""A train waits this much longer while the queue looks occupied. Then it leaves all the same, as the measured delay may
be mistaken [s]."""

TIMEOUT = 0.5
"""A train that has not been reported this long after it should have left is lost [s]."""


class Train(NamedTuple):
    """Datagrams that are due anyway leave faster."""
    rate: float
    """Rate at which they leave [byte/s]."""
    size: float
    """Bytes that leave at this rate [byte]."""


class OnTheWay(NamedTuple):
    """A train that was not reported yet."""
    begins: float
    """Bytes of all streams sent before the train."""
    ends: float
    """Bytes of all streams sent up to the end of the train."""
    left: float
    """Time at which the train began to leave [s]."""
    lost: float
    """Time at which the train counts as lost [s]."""


class TrainTracker:
    """Follows one train at a time."""

    def __init__(self) -> None:
        self.on_the_way: Optional[OnTheWay] = None

    def leave(self, train: Train, newest: PacketSample, unreported: int, now: float, timeout: float) -> None:
        """A train leaves.

        :param newest: sample of the newest datagram that arrived
        :param unreported: bytes sent since
        :param now: by a steady clock [s]
        :param timeout: after which it counts as lost [s]
        """
        begins = newest.total + unreported
        self.on_the_way = OnTheWay(begins, begins + train.size, now, now + timeout)

    def arrived(self, newest: PacketSample) -> bool:
        """Whether the train on the way was reported as a whole."""
        return self.on_the_way is not None and newest.total >= self.on_the_way.ends

    def ended(self, newest: PacketSample, now: float, cut: bool = False) -> Optional[OnTheWay]:
        """The train that was on the way and now is reported, or lost; None: there is none.

        :param cut: whether its end may have been lost, or shows no more
        """
        train = self.on_the_way
        if train is None or not (cut or self.arrived(newest) or now >= train.lost):
            return None
        self.on_the_way = None
        return train


class _Probe(NamedTuple):
    """What was known as the last train left."""
    capacity: float = math.inf
    """[byte/s]"""
    empty: bool = False
    """Whether the queue was empty."""
    sure: bool = False
    """Whether nothing but a shaper could delay it."""
    due: float = 0.0
    """What had to leave at once for it [byte]."""
    beside: float = 0.0
    """What might leave beside that [byte]."""


class ProbeController:
    """Decides when a train leaves: one at a time, while the queue is empty and the streams want more."""

    def __init__(self) -> None:
        self._trains = TrainTracker()
        self._last = _Probe()
        self._succeeded = self._queued = False      # the last one, and whether datagrams of its time waited
        self._next = -math.inf      # not before [s]
        self._interval = RETRY_INTERVAL     # after the next unsuccessful train [s]
        self._wished = -math.inf    # where streams only wish for more: not before [s]

    def planned(self, budget: float, total: float) -> float:
        """For what multiple streams are planned while a train leaves.

        :param budget: what they are planned for without it [byte/s]
        :param total: bytes of all streams sent so far
        """
        train = self._trains.on_the_way
        due = min(self._last.due, train.ends - total) if train else 0.0
        return min(max(1.0, due / (DUE_TIME * budget)), MAX_PLANNED)

    def most(self, depth: float) -> float:
        """What the last train may show behind a token bucket [byte, byte/s]."""
        known = self._last.capacity
        return (MAX_LASTING_STEP if depth > LASTING * known else MAX_STEP) * known

    def retry(self) -> None:
        """Wait no longer after an unsuccessful train."""
        self._next = self._wished = -math.inf
        self._interval = RETRY_INTERVAL

    def next(self, seen: Observation, capacity: float, depth: float, sure: bool, empty: bool, wanted: bool,
             wished: bool) -> Optional[Train]:
        """The train that leaves now, if any.

        :param seen: what the newest report shows
        :param capacity: as known [byte/s]
        :param depth: of a shaper on the path [byte]
        :param sure: whether there is one for sure
        :param empty: whether the queue is
        :param wanted: whether the streams would send more than they may
        :param wished: whether what they send would be fresher if the link had more
        """
        now = seen.now
        self._queued |= seen.is_queued
        if self._trains.on_the_way and not self._judge(seen, capacity, depth, empty):
            return None
        if not (wanted or wished and now >= self._wished) or now < self._next:
            return None
        least = MIN_PACKETS * seen.newest.size
        train, due = self._train(capacity, depth, sure and empty, seen)
        if not empty and (train.size <= least or now < self._next + QUEUED_RETRY_INTERVAL):
            return None
        self._last, self._queued = _Probe(capacity, empty, sure and empty, due, train.size - due), False
        self._trains.leave(train, seen.newest, seen.feedback.unreported, now, TIMEOUT + train.size / capacity)
        return train

    def _train(self, capacity: float, depth: float, sure: bool, seen: Observation) -> Tuple[Train, float]:
        """(a train that shows whether the path carries more, what of it has to leave at once [byte]).

        :param sure: whether nothing but a shaper can delay it
        """
        if not _is_deep(depth, capacity):
            gain = NEXT_GAIN if self._succeeded else FIRST_GAIN
            beyond = max(DURATION, FIRST_GAIN * BEYOND_NOISE * seen.noise) * capacity
            size = max(MIN_PACKETS * seen.newest.size, beyond + EXCESS * depth * gain)
            return Train(gain * capacity, size), size
        longest = max(sample.size for sample in seen.chain) if sure else seen.newest.size
        beyond = max((BEYOND + BEYOND_NOISE * seen.noise) * capacity, MIN_PACKETS * longest)
        if depth + beyond <= MAX_PLANNED * REACHED * DUE_TIME * capacity:
            due = (depth + beyond) * AT_ONCE / (AT_ONCE - 1) / FILLED
            beside = DUE_TIME * capacity if sure else 0.0       # a message may be in the making
            return Train(AT_ONCE * capacity, due + beside), due
        size = depth / (1 - GROWTH / (REACHED * MAX_PLANNED))
        return Train(NEXT_GAIN * capacity, size), size

    def _judge(self, seen: Observation, capacity: float, depth: float, empty: bool) -> bool:
        """Whether the train on the way has ended; then it is judged.

        Behind a shaper that is sure it ends once it has shown something: more, or a queue where there was none, beside
        which the rate was measured, and which the rest of it would only prolong.

        :param empty: whether the queue is, after it
        """
        complete, grown = self._trains.arrived(seen.newest), capacity > SUCCESS_FACTOR * self._last.capacity
        shown = self._last.sure and depth > 0 and (grown or seen.carried > 0)
        if self._trains.ended(seen.newest, seen.now, shown) is None:
            return False
        # where the queue was not empty others may have paused when it arrived
        self._succeeded = self._last.empty and grown
        if self._succeeded:
            self._interval = RETRY_INTERVAL
        else:
            cleared = self._last.beside > 0 and not self._queued if _is_deep(depth, capacity) else empty
            waits = CLEAR_RETRY_INTERVAL if cleared else RETRY_INTERVAL + REFILL_INTERVALS * depth / capacity
            self._next = seen.now + waits
            self._wished = seen.now + self._interval
            if complete:
                self._interval = min(2 * self._interval, MAX_RETRY_INTERVAL)
        return True


def _is_deep(depth: float, capacity: float) -> bool:
    """Whether a shaper lets pass at once what a train has beyond the tokens [byte, byte/s]."""
    return depth > DURATION * capacity
