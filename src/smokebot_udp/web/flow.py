# SPDX-License-Identifier: BSD-3-Clause
"""What is on the way to one browser: it acknowledges frames, and a slow one gets fewer, never older ones."""
import collections
from typing import Deque, Hashable, NamedTuple

MAX_IMAGES = 2
"""Number of images of one stream that are on the way."""

MAX_BYTES = 256 * 1024
"""Size of all frames that are on the way; a larger one leaves alone [byte]."""


class _Sent(NamedTuple):
    number: int
    stream: Hashable
    size: int


class Flow:
    """Counts the frames of one browser."""

    def __init__(self) -> None:
        self.number = 0
        """Number of the last frame."""
        self._waiting: Deque[_Sent] = collections.deque()
        self._size = 0

    def room(self, stream: Hashable, most: int = MAX_IMAGES) -> bool:
        """Whether a frame may be sent.

        :param stream: what it belongs to
        :param most: frames of this stream that may be on the way
        """
        return self._size < MAX_BYTES and sum(one.stream == stream for one in self._waiting) < most

    def next(self) -> int:
        """The number of the next frame."""
        self.number = (self.number + 1) & 0xFFFFFFFF
        return self.number

    def sent(self, stream: Hashable, size: int) -> None:
        """The frame of the last number is on the way."""
        self._waiting.append(_Sent(self.number, stream, size))
        self._size += size

    def shown(self, number: int) -> None:
        """A frame, and all before it, were drawn. One that is not on the way says nothing."""
        if not any(one.number == number for one in self._waiting):
            return
        while self._waiting:
            first = self._waiting.popleft()
            self._size -= first.size
            if first.number == number:
                return
