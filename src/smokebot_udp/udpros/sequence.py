# SPDX-License-Identifier: BSD-3-Clause
"""How much of a topic was lost, told by the sequence numbers in its messages' headers.

Both client libraries number a topic's messages in std_msgs/Header.seq as they publish. What is missing
between the lowest and the highest number seen was lost, or is still on its way.
"""
import numpy as np

WINDOW = 4096
"""How far behind the highest number a late message is still told from a duplicate [messages]."""

JUMP = 1 << 20
"""A number further ahead than this, or WINDOW behind, is a stray: it is neither counted nor held back. Two
strays in a row (as in RFC 3550, A.1) are another counting: the publisher began anew."""

_STEPS = np.arange(1, WINDOW, dtype=np.int32)


class SequenceTracker:
    """Counts of one connection: received, lost, duplicates, and the restarts of its numbering."""

    def __init__(self):
        self.received = self.lost = self.duplicates = self.restarts = 0
        self._seen = np.zeros(WINDOW, bool)   # of the numbers up to the highest, at their place modulo WINDOW
        self._highest = None                  # np.uint32
        self._span = 0                        # how many numbers from the lowest to the highest
        self._stray = None

    def add(self, seqs):
        """Note a batch of sequence numbers.

        :param seqs: (n,) uint32, in order of arrival
        :return: (n,) bool, False where the number was seen before
        """
        seqs = np.asarray(seqs, np.uint32)
        if not len(seqs):
            return np.zeros(0, bool)
        if self._highest is None:
            self._begin(int(seqs[0]))
        ahead = (seqs - self._highest).view(np.int32)
        if len(seqs) < WINDOW and (ahead == _STEPS[:len(seqs)]).all():
            return self._add_next(len(seqs))
        low, high = int(ahead.min()), int(ahead.max())
        if high <= JUMP and low > max(high, 0) - WINDOW:
            return self._add_near(seqs, low, high)
        if len(seqs) > 1:
            return np.concatenate([self.add(seqs[i:i + 1]) for i in range(len(seqs))])
        return self._add_stray(int(seqs[0]))

    def add_next(self, seq):
        """Note one number if it is the one after the highest, as `add` would; returns whether it was."""
        if self._highest is None or seq != (int(self._highest) + 1) & 0xffffffff:
            return False
        self._seen[seq % WINDOW] = True
        self._raise_highest(1)
        self.received += 1
        return True

    def _begin(self, first):
        self._highest, self._span, self._stray = np.uint32(first - 1 & 0xffffffff), 0, None
        self._seen[:] = False

    def _add_next(self, count):
        """The ordinary case, in which nothing is lost: the `count` numbers after the highest, in order."""
        begin = (int(self._highest) + 1) % WINDOW
        self._seen[begin:begin + count] = True
        self._seen[:max(0, begin + count - WINDOW)] = True
        self._raise_highest(count)
        self.received += count
        return np.ones(count, bool)

    def _add_near(self, seqs, low, high):
        """Numbers that the window holds, from `low` to `high` ahead of the highest."""
        below = max(0, 1 - low - self._span)   # late ones from before the lowest
        above = max(0, high)
        self._seen[np.arange(int(self._highest) + 1, int(self._highest) + 1 + min(above, WINDOW)) % WINDOW] = False
        self._raise_highest(above)
        self._span += below
        place = seqs % WINDOW
        fresh = ~self._seen[place] & _first_of_each(place)
        self._seen[place] = True
        count = int(np.count_nonzero(fresh))
        self.received += count
        self.lost += below + above - count
        self.duplicates += len(seqs) - count
        return fresh

    def _raise_highest(self, steps):
        self._highest = np.uint32(int(self._highest) + steps & 0xffffffff)
        self._span += steps

    def _add_stray(self, number):
        before, self._stray = self._stray, number
        if before == number:
            self.duplicates += 1
            return np.zeros(1, bool)
        if before is not None and (before + 1) & 0xffffffff == number:
            self.restarts += 1
            self._begin(before)
            self._add_next(2)
        return np.ones(1, bool)


def _first_of_each(values):
    """(n,) bool: True where a value stands for the first time."""
    first = np.zeros(len(values), bool)
    first[np.unique(values, return_index=True)[1]] = True
    return first
