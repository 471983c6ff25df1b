# SPDX-License-Identifier: BSD-3-Clause
"""States that several sources report again and again: only the newest of each is worth sending."""
import collections
import math
from typing import Optional, OrderedDict

MAX_SOURCES = 256
"""Sources that are remembered; of others the one that has waited longest is forgotten."""


class Newest:
    """What waits for one peer: at most one message of each source; the sources take turns."""

    def __init__(self) -> None:
        self._waiting: OrderedDict[str, bytes] = collections.OrderedDict()     # the longest waiting source first
        self._next = -math.inf      # when the next one may be sent [s]

    def put(self, source: str, data: bytes) -> None:
        """A source's message replaces the one of it that waits; its turn stays."""
        self._waiting[source] = data
        while len(self._waiting) > MAX_SOURCES:
            self._waiting.popitem(last=False)

    def take(self, rate: float, now: float) -> Optional[bytes]:
        """The message to send now; None: nothing waits, or it is too soon after the last one.

        :param rate: what all may take, on average [byte/s]
        :param now: by a steady clock [s]
        """
        if not self._waiting or now < self._next:
            return None
        _, data = self._waiting.popitem(last=False)
        self._next = now + len(data) / rate
        return data
