# SPDX-License-Identifier: BSD-3-Clause
"""What was received once is not taken again.

* ReplayWindow: the counters of a session's datagrams (RFC 6479 does the same). A counter that is WINDOW or more behind
  the highest is too old. Only counters of authentic datagrams are noted: a forged one must not stand for the true one.
* HandshakeMemory: the ephemeral keys of authentic first messages, for as long as their cookie is valid.
"""
import collections

import numpy as np

from ..arrays import BoolArray, IntArray
from ..udpros.sequence import first_of_each

WINDOW = 2048
"""How far behind the highest counter a late datagram is taken [datagrams]."""

MAX_HANDSHAKES = 4096
"""Remembered; only who has the key can add one."""


class ReplayWindow:
    """The counters seen of one session."""

    def __init__(self) -> None:
        self.highest = -1
        """The highest counter noted; -1 before the first."""
        self._seen: BoolArray = np.zeros(WINDOW, bool)      # of (highest - WINDOW, highest], modulo WINDOW

    def fresh(self, counters: IntArray) -> BoolArray:
        """Which counters are neither noted nor too old: (n,) bool for (n,) int64 of at least 0."""
        later = counters > self.highest
        if later.all():
            return later
        result: BoolArray = later | ((counters > self.highest - WINDOW) & ~self._seen[counters % WINDOW])
        return result

    def note(self, counters: IntArray) -> BoolArray:
        """Note the counters of authentic datagrams, all of them `fresh`.

        :param counters: (n,) int64
        :return: (n,) bool, False where one stands a second time among them
        """
        if not len(counters):
            return np.zeros(0, bool)
        first = first_of_each(counters)
        top = int(counters.max())
        if top > self.highest:
            self._seen[np.arange(max(self.highest, top - WINDOW) + 1, top + 1) % WINDOW] = False
            self.highest = top
        self._seen[counters[counters > self.highest - WINDOW] % WINDOW] = True
        return first


class HandshakeMemory:
    """The first messages taken within a time, newest MAX_HANDSHAKES.

    :param lifetime: [s]
    """

    def __init__(self, lifetime: float) -> None:
        self._lifetime = lifetime
        self._taken: collections.OrderedDict[bytes, float] = collections.OrderedDict()    # {ephemeral: when}

    def __len__(self) -> int:
        return len(self._taken)

    def __contains__(self, ephemeral: bytes) -> bool:
        return ephemeral in self._taken

    def add(self, ephemeral: bytes, now: float) -> None:
        """Remember one, and forget the oldest."""
        self._taken[ephemeral] = now
        while len(self._taken) > MAX_HANDSHAKES or now - next(iter(self._taken.values())) > self._lifetime:
            self._taken.popitem(last=False)
