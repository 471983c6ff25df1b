# SPDX-License-Identifier: BSD-3-Clause
"""The capacity of a path and how sure it is: a Kalman filter of one value, whose errors are relative.

R. E. Kalman, "A New Approach to Linear Filtering and Prediction Problems", Journal of Basic Engineering 82, 1960. The
capacity drifts; a measurement over a short time, of few datagrams, or where delays are noisy, counts for little. One
that contradicts what is known shows that the link has changed, and counts for much.
"""
import math

DRIFT = 0.12
"""The capacity drifts by this standard deviation [1 / sqrt(s)]."""

CONTRADICTION = 3.0
"""A measurement that differs by this many standard deviations shows that the link has changed."""

CONFIRMED = 0.3
"""A lower capacity is measured again within this time, by the queue that it causes [s]."""

TIMING = 2.0
"""Both ends of the measured time are uncertain by the noise of delays: together by this multiple."""

COUNTING = 0.5
"""The ends of the measured time may miss this part of a datagram."""

SPREAD_WEIGHT = 0.3
"""Weight of the newest difference in `spread`."""

UNKNOWN = 1.0
"""Variance where nothing is known."""


class Capacity:
    """What a path carries.

    :param value: [byte/s]
    """

    def __init__(self, value: float) -> None:
        self.value = value
        """[byte/s]"""
        self.spread = 0.0
        """How much measurements differ from the ones before, lately; relative."""
        self._last = 0.0        # measured [byte/s]
        self._variance, self._at = UNKNOWN, -math.inf
        self._doubted = 0.0     # what one measurement has contradicted, and none confirmed yet [byte/s]

    def measure(self, rate: float, duration: float, packets: int, noise: float, trust: float, at: float) -> None:
        """Take a measurement.

        :param rate: carried while the air was busy [byte/s]
        :param duration: how long it was [s]
        :param packets: datagrams that arrived meanwhile
        :param noise: of delays [s]
        :param trust: how far a lower value is believed, 0..1
        :param at: when, by a steady clock [s]
        """
        self._variance = min(UNKNOWN, self._variance + DRIFT ** 2 * (at - self._at))
        self._at = at
        error = (TIMING * noise / duration) ** 2 + (COUNTING / packets) ** 2
        difference = rate / self.value - 1
        contradicts = difference ** 2 > CONTRADICTION ** 2 * (self._variance + error)
        self._doubted = self.value if contradicts and difference < 0 else 0.0
        if contradicts:
            self._variance = min(UNKNOWN, difference ** 2)
        gain = self._variance / (self._variance + error)
        self._variance *= 1 - gain
        if self._last:
            self.spread += SPREAD_WEIGHT * (abs(rate / self._last - 1) - self.spread)
        self._last = rate
        self.value += gain * (1.0 if difference > 0 else trust) * (rate - self.value)

    def recall(self, now: float) -> None:
        """No queue is seen: a lower value that a single measurement showed was no capacity, but a late datagram."""
        if self._doubted and now - self._at > CONFIRMED:
            self.value, self._doubted = max(self.value, self._doubted), 0.0

    def carries(self, rate: float) -> None:
        """The path carries at least this [byte/s]: what was measured before no longer counts where that is more."""
        if rate > self.value:
            self._variance = max(self._variance, min(UNKNOWN, (rate / self.value - 1) ** 2))
            self.value = rate

    def forget(self) -> None:
        """Nothing that was measured counts any more."""
        self._variance, self._at, self._doubted = UNKNOWN, -math.inf, 0.0
