# SPDX-License-Identifier: BSD-3-Clause
"""Tiles that contradict what is held: of an older revision, or of the same one with other cells.

Mostly they are late. But the robot repeats the tiles of its present map as long as they are not reported as held: one
that is received again after LATENESS is right, and what is held was forged. So no forged tile stays.
"""
import collections
from typing import Deque, Tuple

from .canvas import Identity

LATENESS = 1.0
"""No link and no queue delays a datagram by as much behind those sent after it [s]."""

FORGOTTEN = 30.0
"""[s]"""

MAX_REMEMBERED = 256


class Repetitions:
    """Remembers the last tiles that contradict what is held."""

    def __init__(self) -> None:
        self._seen: Deque[Tuple[Identity, float]] = collections.deque(maxlen=MAX_REMEMBERED)

    def clear(self) -> None:
        self._seen.clear()

    def proven(self, tile: Identity, now: float) -> bool:
        """Note a tile; whether it was noted already, LATENESS ago.

        :param now: by any steady clock [s]
        """
        while self._seen and now - self._seen[0][1] > FORGOTTEN:
            self._seen.popleft()
        first = next((since for known, since in self._seen if known == tile), None)
        if first is None:
            self._seen.append((tile, now))
        return first is not None and now - first >= LATENESS
