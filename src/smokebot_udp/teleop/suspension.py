# SPDX-License-Identifier: BSD-3-Clause
"""Notices that the machine was suspended, such as a laptop whose lid was closed.

The steady clock stands still then, so that what waited in a socket meanwhile seems to be as new as before. Another
clock of the system, since its boot, runs on: it gets ahead.
"""
import math

MIN_SUSPENSION = 0.05
"""A shorter one makes nothing too old [s]."""


class Suspension:
    """Compares the two clocks. Threads of a busy machine read them at different times, so all of it is in bounds."""

    def __init__(self) -> None:
        self._most = math.inf   # by which the clock since the boot may have been ahead, until now [s]

    def notice(self, before: float, since_boot: float, after: float) -> bool:
        """Whether the machine was suspended since the last call, or the one before it.

        :param before, after: the steady clock, read before and after `since_boot` [s]
        :param since_boot: the clock that runs on [s]
        """
        noticed = since_boot - after > self._most + MIN_SUSPENSION
        self._most = since_boot - before if noticed else min(self._most, since_boot - before)
        return noticed
