# SPDX-License-Identifier: BSD-3-Clause
"""States that several sources report again and again: only the newest of each is worth sending."""
import collections
from typing import Optional, OrderedDict

MAX_SOURCES = 256
"""Sources that are remembered; of others the one that has waited longest is forgotten."""


class Newest:
    """What waits for one peer: at most one message of each source; the sources take turns."""

    def __init__(self) -> None:
        self._waiting: OrderedDict[str, bytes] = collections.OrderedDict()     # the longest waiting source first

    def put(self, source: str, data: bytes) -> None:
        """A source's message replaces the one of it that waits; its turn stays."""
        self._waiting[source] = data
        while len(self._waiting) > MAX_SOURCES:
            self._waiting.popitem(last=False)

    def take(self) -> Optional[bytes]:
        """The message to send next; None: nothing waits."""
        return self._waiting.popitem(last=False)[1] if self._waiting else None
