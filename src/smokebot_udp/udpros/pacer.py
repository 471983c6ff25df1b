# SPDX-License-Identifier: BSD-3-Clause
"""Spreads datagrams in time, so that no queue on the way overflows from our bursts alone.

A token bucket (RFC 2697's committed rate and burst size): `burst` bytes may leave at once, then `rate`
bytes a second. roscpp's receiver holds only 92 full datagrams, and a Wi-Fi driver's queue not many more.
"""
import math
import threading


class Pacer:
    """When the next bytes may leave. One pacer may serve several publishers: they share its rate.

    :param rate: [byte/s]; None: unlimited
    :param burst: bytes that may leave at once after a pause [byte]
    :raises ValueError: where rate or burst is not positive and finite
    """

    def __init__(self, rate=None, burst=16 * 1472):
        if (rate is not None and not 0 < rate < math.inf) or not 0 < burst < math.inf:
            raise ValueError('a pacer needs a positive and finite rate and burst, not %r and %r' % (rate, burst))
        self.rate, self.burst = rate, burst
        self._full_at = None   # when the bucket is full again, if nothing more leaves
        self._lock = threading.Lock()

    def reserve(self, size, now):
        """Take `size` bytes and return when they may leave: now, or a later time [s, on the same steady clock]."""
        if self.rate is None:
            return now
        with self._lock:
            full_at = now if self._full_at is None else max(now, self._full_at)
            leave = max(now, full_at + (size - self.burst) / self.rate)
            self._full_at = full_at + size / self.rate
        return leave
