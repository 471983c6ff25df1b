# SPDX-License-Identifier: BSD-3-Clause
"""How much of a topic was lost, told by the sequence numbers in its messages' headers.

Both client libraries number a topic's messages in std_msgs/Header.seq as they publish. What is missing
between the first and the highest number seen was lost, or is still on its way.
"""
import numpy as np

WINDOW = 4096
"""How far behind the highest number a late message is still told from a duplicate [messages]."""

JUMP = 1 << 20
"""Numbers further ahead than this are no loss but another counting: the publisher began anew."""


class SequenceTracker:
    """Counts of one connection: received, duplicates and, derived, lost."""

    def __init__(self):
        self.received = 0
        self.duplicates = 0
        self.restarts = 0
        self._span = 0        # numbers between the first and the highest, both included
        self._highest = None
        self._seen = np.zeros(WINDOW, bool)

    @property
    def lost(self):
        return max(0, self._span - self.received)

    def add(self, seqs):
        """Note a batch of sequence numbers.

        :param seqs: (n,) uint32, n <= WINDOW, in order of arrival
        :return: (n,) bool, False where the number was seen before
        """
        seqs = np.asarray(seqs, np.uint32)
        if not len(seqs):
            return np.zeros(0, bool)
        if self._highest is None:
            self._restart(seqs[0])
        ahead = (seqs - self._highest).view(np.int32).astype(np.int64)
        if ahead.max() > JUMP or ahead.min() <= -WINDOW:
            self.restarts += 1
            self._restart(seqs[0])
            ahead = np.clip((seqs - self._highest).view(np.int32).astype(np.int64), 1 - WINDOW, JUMP)
        self._advance(max(0, int(ahead.max())))
        place = seqs % WINDOW
        fresh = ~self._seen[place] & _first_of_each(place)
        fresh &= ahead > ahead.max() - WINDOW
        self._seen[place] = True
        count = int(np.count_nonzero(fresh))
        self.received += count
        self.duplicates += len(seqs) - count
        return fresh

    def _restart(self, first):
        """Count on from `first`; what was lost before stays counted."""
        self._span = self.received + self.lost
        self._highest = np.uint32(int(first) - 1 & 0xffffffff)
        self._seen[:] = False

    def _advance(self, steps):
        ahead = np.arange(1, min(steps, WINDOW) + 1, dtype=np.uint32)
        if steps > WINDOW:
            self._seen[:] = False
        else:
            self._seen[(self._highest + ahead) % np.uint32(WINDOW)] = False
        self._highest = np.uint32(int(self._highest) + steps & 0xffffffff)
        self._span += steps


def _first_of_each(values):
    """(n,) bool: True where a value stands for the first time."""
    if len(values) < 2 or np.all(values[1:] > values[:-1]):
        return np.ones(len(values), bool)
    first = np.zeros(len(values), bool)
    first[np.unique(values, return_index=True)[1]] = True
    return first
