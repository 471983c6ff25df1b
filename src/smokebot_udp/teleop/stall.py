# SPDX-License-Identifier: BSD-3-Clause
"""Notices that a node stood still: it was stopped, or its machine had no memory or processor time for it.

What waited in its sockets meanwhile looks as if it had just come. A command that waited is as old as the stall.
"""
import math

MAX_GAP = 0.4
"""From one look to the next; a longer one is a stall. Less than the usual timeout of commands [s]."""

RECOVERY = 0.2
"""Time that a node takes to read what has waited [s]."""

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
