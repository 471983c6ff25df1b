# SPDX-License-Identifier: BSD-3-Clause
"""When a program is started again that has ended."""
from ..backoff import Backoff

STABLE_TIME = 10.0
"""A program that ran for this time is started again soon; otherwise later and later [s]."""

MIN_DELAY, MAX_DELAY = 1.0, 60.0
"""[s]"""


class Restarts:
    """The delays of one program."""

    def __init__(self) -> None:
        self._delays = Backoff(MIN_DELAY, MAX_DELAY)

    def delay(self, lifetime: float) -> float:
        """Time until it has to be started again [s].

        :param lifetime: how long it ran [s]
        """
        if lifetime >= STABLE_TIME:
            self._delays.reset()
        return self._delays.take()
