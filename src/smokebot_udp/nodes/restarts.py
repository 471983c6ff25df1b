# SPDX-License-Identifier: BSD-3-Clause
"""When a program is started again that has ended."""

STABLE_TIME = 10.0
"""A program that ran for this time is started again soon; otherwise later and later [s]."""

MIN_DELAY, MAX_DELAY = 1.0, 60.0
"""[s]"""


class Restarts:
    """The delays of one program."""

    def __init__(self) -> None:
        self._delay = MIN_DELAY

    def delay(self, lifetime: float) -> float:
        """Time until it has to be started again [s].

        :param lifetime: how long it ran [s]
        """
        if lifetime >= STABLE_TIME:
            self._delay = MIN_DELAY
        delay, self._delay = self._delay, min(2 * self._delay, MAX_DELAY)
        return delay
