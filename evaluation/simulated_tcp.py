# SPDX-License-Identifier: BSD-3-Clause
"""TCP downloads over a simulated path: congestion control by CUBIC (RFC 9438, HyStart) and by BBR
(draft-cardwell-iccrg-bbr-congestion-control-00). Segments have sizes and times, and no content; each is acknowledged.

A segment is taken for lost when one that left after it was acknowledged (RACK without reordering, RFC 8985), or all of
them where nothing was for a second. Retransmissions are segments like others.
"""
import collections
import math
from typing import Deque, Dict, List, NamedTuple, Tuple

from .simulated_air import FULL, Events
from .simulated_paths import Path

INITIAL_WINDOW = 10.0
"""[segment] (RFC 6928)"""

MIN_RTO = 1.0
"""Nothing acknowledged for this long: all is lost [s] (RFC 6298)."""


class Ack(NamedTuple):
    """What an acknowledgement shows."""
    round_trip: float
    """[s]"""
    rate: float
    """Delivery rate over this round trip [segment/s]."""
    delivered: int
    """Segments so far."""
    delivered_before: int
    """Segments when this one left."""


class CongestionControl:
    """Decides how much may be sent."""
    window = INITIAL_WINDOW
    """[segment]"""
    pacing = math.inf
    """[segment/s]"""

    def on_ack(self, ack: Ack, now: float) -> None:
        """A segment was acknowledged."""

    def on_loss(self, now: float) -> None:
        """Segments were lost, for the first time in a round trip."""

    def on_timeout(self, now: float) -> None:
        """Nothing is acknowledged any more."""


class Cubic(CongestionControl):
    """RFC 9438, and the exit from slow start by a growing delay (HyStart, RFC 9406)."""
    C, BETA = 0.4, 0.7
    HYSTART_MIN, HYSTART_MAX = 0.004, 0.016

    def __init__(self) -> None:
        self._threshold, self._least = math.inf, math.inf
        self._peak, self._epoch, self._reno = 0.0, math.nan, 0.0

    def on_ack(self, ack: Ack, now: float) -> None:
        self._least = min(self._least, ack.round_trip)
        if self.window < self._threshold:
            self.window += 1
            margin = min(max(self._least / 8, self.HYSTART_MIN), self.HYSTART_MAX)
            if self.window >= 16 and ack.round_trip > self._least + margin:
                self._threshold = self.window
            return
        if math.isnan(self._epoch):
            self._epoch, self._reno = now, self.window
            self._peak = max(self._peak, self.window)
        from_peak = now - self._epoch + ack.round_trip - math.pow(self._peak * (1 - self.BETA) / self.C, 1 / 3)
        target = self.C * from_peak ** 3 + self._peak
        self._reno += 3 * (1 - self.BETA) / (1 + self.BETA) / self.window
        self.window += max(0.0, min(target, 1.5 * self.window) - self.window) / self.window
        self.window = max(self.window, self._reno)

    def on_loss(self, now: float) -> None:
        falling = self.window < self._peak
        self._peak = self.window * ((1 + self.BETA) / 2 if falling else 1)
        self.window = self._threshold = max(2.0, self.window * self.BETA)
        self._epoch = math.nan

    def on_timeout(self, now: float) -> None:
        self.on_loss(now)
        self.window = 1.0


class Bbr(CongestionControl):
    """Version 1."""
    HIGH_GAIN = 2.885
    CYCLE = 1.25, 0.75, 1, 1, 1, 1, 1, 1
    BANDWIDTH_ROUNDS, MIN_RTT_LIFETIME, PROBE_RTT_DURATION = 10, 10.0, 0.2

    def __init__(self) -> None:
        self._rates: Deque[Tuple[int, float]] = collections.deque()     # (round, rate), falling
        self._round = self._round_ends = 0
        self._min_rtt, self._min_rtt_at = math.inf, 0.0
        self._state, self._full, self._full_rounds = 'startup', 0.0, 0
        self._phase, self._phase_at, self._probe_ends = 2, 0.0, math.nan

    def on_ack(self, ack: Ack, now: float) -> None:
        new_round = ack.delivered_before >= self._round_ends
        if new_round:
            self._round, self._round_ends = self._round + 1, ack.delivered
        while self._rates and (self._rates[-1][1] <= ack.rate):
            self._rates.pop()
        self._rates.append((self._round, ack.rate))
        while self._rates[0][0] <= self._round - self.BANDWIDTH_ROUNDS:
            self._rates.popleft()
        expired = now > self._min_rtt_at + self.MIN_RTT_LIFETIME
        if ack.round_trip <= self._min_rtt or expired:
            self._min_rtt, self._min_rtt_at = ack.round_trip, now
        self._change_state(new_round, expired, now)
        self._set(now)

    def on_timeout(self, now: float) -> None:
        self.window = 4.0

    def _change_state(self, new_round: bool, expired: bool, now: float) -> None:
        bandwidth = self._rates[0][1]
        if self._state == 'startup' and new_round:
            if bandwidth >= 1.25 * self._full:
                self._full, self._full_rounds = bandwidth, 0
            else:
                self._full_rounds += 1
            if self._full_rounds >= 3:
                self._state, self._phase_at = 'drain', now
        elif self._state == 'drain' and now - self._phase_at > self._min_rtt * (1 + self.HIGH_GAIN / 2):
            self._state, self._phase, self._phase_at = 'probe_bw', 2, now
        elif self._state == 'probe_bw' and now - self._phase_at > self._min_rtt:
            self._phase, self._phase_at = (self._phase + 1) % len(self.CYCLE), now
        if expired and self._state != 'probe_rtt':
            self._state, self._probe_ends = 'probe_rtt', now + self.PROBE_RTT_DURATION + self._min_rtt
        elif self._state == 'probe_rtt' and now > self._probe_ends:
            self._state, self._phase, self._phase_at = 'probe_bw', 2, now

    def _set(self, now: float) -> None:
        gains = {'startup': (self.HIGH_GAIN, self.HIGH_GAIN), 'drain': (1 / self.HIGH_GAIN, self.HIGH_GAIN),
                 'probe_bw': (self.CYCLE[self._phase], 2.0), 'probe_rtt': (1.0, 0.0)}
        pacing, window = gains[self._state]
        bandwidth = self._rates[0][1]
        self.pacing = pacing * bandwidth
        self.window = max(4.0, window * bandwidth * self._min_rtt)


class _Segment(NamedTuple):
    sent: float
    delivered: int
    delivered_at: float


class Tcp:
    """One download that always has more.

    :param there: path of the segments
    :param back: delay of the acknowledgements [s]
    :param starts: when [s]
    """

    def __init__(self, events: Events, there: Path, back: float, control: CongestionControl,
                 starts: float = 0.0) -> None:
        self.control = control
        self.came: List[Tuple[float, int]] = []
        """(when, size) of each segment that arrived"""
        self._events, self._there, self._back = events, there, back
        self._flying: Dict[int, _Segment] = {}      # in the order of sending
        self._next = self._delivered = self._recovered = 0
        self._delivered_at = self._heard = self._may_send = starts
        self._planned = False
        events.at(starts, self._send)
        events.at(starts, self._watch)

    def _send(self) -> None:
        now = self._events.now
        self._planned = False
        while len(self._flying) < int(self.control.window):
            if now < self._may_send - 1e-9:
                self._planned = True
                self._events.at(self._may_send, self._send)
                return
            self._may_send = max(now, self._may_send) + 1 / self.control.pacing
            number, self._next = self._next, self._next + 1
            if not self._flying:
                self._heard = self._delivered_at = now
            self._flying[number] = _Segment(now, self._delivered, self._delivered_at)
            for time in self._there.fate(now, FULL)[:1]:
                self._events.at(time, self._arrive, number)

    def _arrive(self, number: int) -> None:
        self.came.append((self._events.now, FULL))
        self._events.at(self._events.now + self._back, self._acknowledge, number)

    def _acknowledge(self, number: int) -> None:
        now = self._events.now
        segment = self._flying.pop(number, None)
        if segment is not None:
            self._heard = self._delivered_at = now
            self._delivered += 1
            interval = max(now - segment.delivered_at, 1e-6)
            rate = (self._delivered - segment.delivered) / interval
            self.control.on_ack(Ack(now - segment.sent, rate, self._delivered, segment.delivered), now)
            lost = []
            for other in self._flying:
                if other > number:
                    break
                lost.append(other)
            for other in lost:
                del self._flying[other]
            if lost and lost[-1] >= self._recovered:
                self._recovered = self._next
                self.control.on_loss(now)
        if not self._planned:
            self._send()

    def _watch(self) -> None:
        now = self._events.now
        if self._flying and now - self._heard > MIN_RTO:
            self._flying.clear()
            self._heard = now
            self.control.on_timeout(now)
            if not self._planned:
                self._send()
        self._events.at(now + 0.1, self._watch)
