# SPDX-License-Identifier: BSD-3-Clause
"""How large the images of a stream may be: what its good images have announced, and a limit.

Decoding an embedded stream costs time and memory by the size that its head announces, however few bytes there are: a
forged datagram could announce millions of pixels. So sizes are bound by what is known of the stream.

* At the start the bound is FIRST, and later the largest size among the good images (those that were decoded) of the
  last MEMORY.
* A larger size is accepted where it is announced twice at least, PROOF apart, and no good image of the bound's size
  comes in between: a source that changes its size falls silent in the former one, and a forger beside it has no such
  silence. As segments of a refused size begin no image, they do not disturb the good ones.
* It is accepted, too, where only larger sizes were announced for PROOF, and no good image at all came: a source may
  change its size more often than PROOF.
* Nothing above MAX_CELLS is accepted.
"""
import math
import threading
from typing import Optional

from ...codecs.layered.layout import MAX_CELLS

FIRST = 640 * 480
"""Larger images are shown from PROOF on after the first one [cell: pixel times channel]."""

PROOF = 0.5
"""[s]"""

MEMORY = 10.0
"""[s]"""


class SizeGuard:
    """Bounds the sizes of the images of one stream. Segments are received in one thread, and decoded in another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._bound = FIRST
        self._confirmed = math.inf              # when a good image had that size [s]
        self._largest = 0                       # of the good images since then
        self._claimed: Optional[int] = None     # the larger size announced last
        self._since = -math.inf                 # when it was announced first [s]
        self._silent_since = math.inf           # when a larger size was announced first since a good image [s]

    def check(self, cells: int, now: float) -> None:
        """Note the size that the head of a new image announces.

        :param cells: height x width x channels
        :param now: by a steady clock, here and below [s]
        :raises ValueError: it is not accepted
        """
        if cells > MAX_CELLS:
            raise ValueError('%d cells are more than %d' % (cells, MAX_CELLS))
        with self._lock:
            if cells <= self._bound:
                return
            if cells != self._claimed:
                self._claimed, self._since = cells, now
            self._silent_since = min(self._silent_since, now)
            if now - min(self._since, self._silent_since) < PROOF:
                raise ValueError('%d cells, where images have %d' % (cells, self._bound))

    def good(self, cells: int, now: float) -> None:
        """Note an image that was decoded."""
        with self._lock:
            self._confirmed = min(self._confirmed, now)
            self._largest = max(self._largest, cells)
            self._silent_since = math.inf
            if cells >= self._bound or now - self._confirmed > MEMORY:
                self._bound, self._confirmed, self._largest = self._largest, now, 0
                self._claimed = None
