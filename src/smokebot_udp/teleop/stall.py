# SPDX-License-Identifier: BSD-3-Clause
"""Notices that a node stood still: it was stopped, or its machine had no memory or processor time for it, or was
suspended, such as a laptop whose lid was closed.

What waited in its sockets meanwhile looks as if it had just come. A command that waited is as old as the stall.

The steady clock stands still while the machine is suspended, so that what waited seems to be as new as before. Another
clock of the system, since its boot, runs on: it gets ahead.
"""
import math

MAX_GAP = 0.4
"""From one look to the next; a longer one is a stall. Less than the usual timeout of commands [s]."""

RECOVERY = 0.2
"""Time that a node takes to read what has waited [s]."""

MIN_SUSPENSION = 0.05
"""A shorter one makes nothing too old [s]."""

STALLED = 'this node stood still'
"""Reason not to send commands."""


class Stall:
    """Looked at by all threads that take what comes, and often besides. Times are by a steady clock [s]."""

    def __init__(self) -> None:
        self._looked = math.inf
        self._until = -math.inf

    def look(self, now: float) -> str:
        """Why what comes now may be old; empty: it is not."""
        if now - self._looked > MAX_GAP:
            self._until = now + RECOVERY
        self._looked = now if self._looked == math.inf else max(self._looked, now)
        return STALLED if now < self._until else ''


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
