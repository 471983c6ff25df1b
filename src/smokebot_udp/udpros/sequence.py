# SPDX-License-Identifier: BSD-3-Clause
"""Packet loss of a topic, from the sequence numbers in its messages' headers.

Both client libraries number a topic's messages in std_msgs/Header.seq as they publish. Numbers missing between the
lowest and the highest one received belong to messages that were lost, or are still on their way.
"""
from typing import Optional, Sequence, Union

import numpy as np

from ..arrays import Array, BoolArray

WINDOW = 4096
"""How far behind the highest number a late message can be distinguished from a duplicate [messages]."""

JUMP = 1 << 20
"""A number further ahead than this, or WINDOW behind, is a stray: it is neither counted nor held back. Two consecutive
strays (as in RFC 3550, A.1) mean that the publisher restarted its numbering."""

MAX_GAP = 32
"""Up to this many lost messages one number is noted without numpy."""

_STEPS = np.arange(1, WINDOW, dtype=np.int32)


class SequenceTracker:
    """Counts the messages of one connection, and recognises duplicates."""

    def __init__(self) -> None:
        self.received = 0
        """Messages received, without duplicates."""
        self.lost = 0
        """Numbers missing so far; falls when a late message arrives."""
        self._seen: BoolArray = np.zeros(WINDOW, bool)  # of the numbers up to the highest, modulo WINDOW
        self._begun = False
        self._highest = self._span = 0              # the highest number, and how many there are from the lowest to it
        self._stray: Optional[int] = None           # the last one

    def add(self, seqs: Union[Array, Sequence[int]]) -> BoolArray:
        """Note a batch of sequence numbers.

        :param seqs: (n,) uint32, in order of arrival
        :return: (n,) bool, False where the number was seen before
        """
        seqs = np.asarray(seqs, np.uint32)
        if not len(seqs):
            return np.zeros(0, bool)
        if not self._begun:
            self._begin(int(seqs[0]))
        ahead = (seqs - np.uint32(self._highest)).view(np.int32)
        if len(seqs) < WINDOW and (ahead == _STEPS[:len(seqs)]).all():
            return self._add_next(len(seqs))
        low, high = int(ahead.min()), int(ahead.max())
        if high <= JUMP and low > max(high, 0) - WINDOW:
            return self._add_near(seqs, low, high)
        if len(seqs) > 1:
            return np.concatenate([self.add(seqs[i:i + 1]) for i in range(len(seqs))])
        return self._add_stray(int(seqs[0]))

    def add_next(self, seq: int) -> bool:
        """Note one number if it follows the highest, with up to MAX_GAP missing between them, as `add` would; returns
        whether it does."""
        gap = (seq - self._highest - 1) & 0xffffffff
        if not self._begun or gap > MAX_GAP:
            return False
        for missing in range(self._highest + 1, self._highest + 1 + gap):
            self._seen[missing % WINDOW] = False
        self._seen[seq % WINDOW] = True
        self._raise_highest(gap + 1)
        self.received += 1
        self.lost += gap
        return True

    def _begin(self, first: int) -> None:
        self._begun, self._highest, self._span, self._stray = True, first - 1 & 0xffffffff, 0, None
        self._seen[:] = False

    def _add_next(self, count: int) -> BoolArray:
        """The ordinary case, in which nothing is lost: the `count` numbers after the highest, in order."""
        begin = (self._highest + 1) % WINDOW
        self._seen[begin:begin + count] = True
        self._seen[:max(0, begin + count - WINDOW)] = True
        self._raise_highest(count)
        self.received += count
        return np.ones(count, bool)

    def _add_near(self, seqs: Array, low: int, high: int) -> BoolArray:
        """Numbers within the window, from `low` to `high` ahead of the highest."""
        below = max(0, 1 - low - self._span)   # late ones from before the lowest
        above = max(0, high)
        self._seen[np.arange(self._highest + 1, self._highest + 1 + min(above, WINDOW)) % WINDOW] = False
        self._raise_highest(above)
        self._span += below
        place = seqs % WINDOW
        fresh: BoolArray = ~self._seen[place]
        if (seqs[1:] - seqs[:-1]).view(np.int32).min(initial=1) <= 0:   # not ascending: there may be duplicates
            fresh &= first_of_each(place)
        self._seen[place] = True
        count = int(np.count_nonzero(fresh))
        self.received += count
        self.lost += below + above - count
        return fresh

    def _raise_highest(self, steps: int) -> None:
        self._highest = self._highest + steps & 0xffffffff
        self._span += steps

    def _add_stray(self, number: int) -> BoolArray:
        before, self._stray = self._stray, number
        if before is not None and (before + 1) & 0xffffffff == number:
            self._begin(before)
            self._add_next(2)
        return np.array([before != number])


def first_of_each(values: Array) -> BoolArray:
    """(n,) bool: True at the first occurrence of a value."""
    if len(values) == 1 or (values[1:] > values[:-1]).all():
        return np.ones(len(values), bool)
    first = np.zeros(len(values), bool)
    first[np.unique(values, return_index=True)[1]] = True
    return first
