# SPDX-License-Identifier: BSD-3-Clause
"""Tells the living session of a node from its former ones, whose datagrams may still come.

A node has a new random session each time it starts. A datagram of a former session that was held up must not be taken
for another restart.
"""
import collections
import math
from typing import Deque

LEASE = 2.0
"""Who is not heard for longer is not there any more [s]."""

MAX_FORMER = 8
"""Former sessions that are remembered."""


class LivingSession:
    """The session of one node. Times are by a steady clock [s]."""

    def __init__(self) -> None:
        self.current = 0
        """0: none was heard."""
        self._former: Deque[int] = collections.deque(maxlen=MAX_FORMER)
        self._heard = -math.inf

    def take(self, session: int, now: float, proven: bool = True) -> bool:
        """Note that a datagram of a session came; returns False where it is not of the living one.

        A former session that outlives the current one was not former: two nodes were started under one name.

        :param proven: whether the datagram shows that it is new; otherwise it does not end a session that is heard
        """
        if session != self.current:
            if (session in self._former or not proven) and now - self._heard <= LEASE:
                return False
            if self.current:
                self._former.append(self.current)
            self.current = session
        self._heard = now
        return True
