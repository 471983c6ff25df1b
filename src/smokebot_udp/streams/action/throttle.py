# SPDX-License-Identifier: BSD-3-Clause
"""The newest message of a topic that repeats itself: what is sent of it over a link."""
from typing import Optional

from ..rate import RateLimiter

REPEAT_PERIOD = 1.0
"""A message that says the same as the last one is sent again after this time [s]."""


class Throttle:
    """Passes the newest message on, at most `rate` times a second. The clock is an argument [s, any steady clock].

    :param rate: [Hz], > 0
    """

    def __init__(self, rate: float) -> None:
        self._limiter = RateLimiter(rate)
        self._waiting: Optional[bytes] = None
        self._content = b''     # of the last message that was taken
        self._repeat = float('-inf')    # when it may be sent again

    def put(self, data: bytes, content: bytes, now: float) -> None:
        """A new message.

        :param data: the message
        :param content: what tells it from another one: `data` without its stamp
        """
        if content != self._content or now >= self._repeat:
            self._waiting, self._content, self._repeat = data, content, now + REPEAT_PERIOD

    def poll(self, now: float) -> Optional[bytes]:
        """What is to be sent now; None: nothing until `deadline`."""
        if self._waiting is None or self._limiter.wait(now):
            return None
        data, self._waiting = self._waiting, None
        self._limiter.take(now)
        return data

    def deadline(self) -> Optional[float]:
        """When the message that waits is to be sent; None: none waits."""
        return None if self._waiting is None else self._limiter.due
