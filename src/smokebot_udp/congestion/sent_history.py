# SPDX-License-Identifier: BSD-3-Clause
"""What left and when, so that a receiver need only say which datagram came: the rest is known here."""
import bisect
from typing import NamedTuple

KEPT = 4096
"""Bursts of each stream; at full speed some seconds of them."""

NUMBERS = 1 << 32
"""std_msgs/Header.seq counts so far."""


class Departure(NamedTuple):
    sent: float
    """By the sender's steady clock [s]."""
    size: int
    """[byte]"""
    total: int
    """Bytes of all streams that had left with it."""


class _Stream:
    """The bursts of one stream, by the number of their first datagram."""

    def __init__(self):
        self.firsts, self.bursts = [], []   # bursts: (count, size, sent, bytes of all streams before)
        self.count = self.bytes = 0

    def note(self, first, count, size, sent, before):
        if self.firsts and first < self.firsts[-1] + self.bursts[-1][0]:
            self.firsts, self.bursts = [], []       # the numbering began anew
        self.firsts.append(first)
        self.bursts.append((count, size, sent, before))
        self.count += count
        self.bytes += count * size
        if len(self.firsts) >= 2 * KEPT:
            del self.firsts[:KEPT], self.bursts[:KEPT]

    @property
    def last(self):
        return self.firsts[-1] + self.bursts[-1][0] - 1


class Departures:
    """Remembers what left, in bounded memory."""

    def __init__(self):
        self.total = 0
        """Bytes of all streams that left."""
        self._streams = {}

    def note(self, stream, first, count, size, now):
        """Datagrams left.

        :param stream: its name
        :param first, count: their numbers: first, first + 1, ... (std_msgs/Header.seq, not wrapped)
        :param size: of each on the air, UDP and IP headers included [byte]
        :param now: when, by a steady clock [s]
        """
        self._streams.setdefault(stream, _Stream()).note(first, count, size, now, self.total)
        self.total += count * size

    def note_unnumbered(self, size):
        """Bytes left in messages that have no number: they take their part of the link, too."""
        self.total += size

    def find(self, stream, seq):
        """The Departure of a datagram; None where it never left, or too long ago.

        :param seq: its number, as a message has it: modulo 2^32
        """
        known = self._streams.get(stream)
        if known is None:
            return None
        seq = known.last - (known.last - seq) % NUMBERS
        at = bisect.bisect_right(known.firsts, seq) - 1
        if at < 0:
            return None
        count, size, sent, before = known.bursts[at]
        place = seq - known.firsts[at] + 1
        return Departure(sent, size, before + place * size) if place <= count else None

    def sent(self, stream):
        """(datagrams, bytes) of a stream that ever left."""
        known = self._streams.get(stream)
        return (known.count, known.bytes) if known else (0, 0)
