# SPDX-License-Identifier: BSD-3-Clause
"""The ratio of an operator's datagrams that do not arrive at the robot, from the sequence numbers in their headers.

As in RTCP's reports (RFC 3550, 6.4.1): of the numbers between the highest at the beginning and the highest at the end
of a window, those are lost that did not come. What was lost after the last one that came is not known.
"""
import collections
from typing import Deque, Dict, Optional, Set, Tuple

WINDOW = 2.0
"""Duration of the window [s]."""

MAX_NUMBERS = 1024
"""Maximum number of sequence numbers that are remembered of a topic. The window is shorter if more arrive."""

MAX_STEP = 1 << 14
"""Maximum distance of a number from the highest one. A number farther away is of a publisher that numbers anew."""

MODULUS = 1 << 32
"""Number of different sequence numbers. After the highest one they begin again with 0."""


class _Topic:
    """The numbers of one topic that came in the window."""

    def __init__(self, seq: int) -> None:
        self.base = self.highest = seq - 1      # not wrapped
        self._came: Deque[Tuple[float, int]] = collections.deque()
        self._seen: Set[int] = set()            # those of `_came`

    def add(self, seq: int, now: float) -> bool:
        """Note a number; returns False where it is not of this numbering."""
        step = (seq - self.highest + MODULUS // 2) % MODULUS - MODULUS // 2
        number = self.highest + step
        if abs(step) > MAX_STEP:
            return False
        if number > self.base and number not in self._seen:
            self._seen.add(number)
            self._came.append((now, number))
            self.highest = max(self.highest, number)
        return True

    def forget(self, now: float) -> None:
        """Forget what came before the window."""
        while self._came and (self._came[0][0] < now - WINDOW or len(self._came) > MAX_NUMBERS):
            _, number = self._came.popleft()
            self._seen.remove(number)
            self.base = max(self.base, number)

    def counts(self) -> Tuple[int, int]:
        """(received, expected) in the window."""
        return sum(number > self.base for number in self._seen), self.highest - self.base


class LossMeter:
    """Measures one operator's loss over all its topics."""

    def __init__(self) -> None:
        self._topics: Dict[str, _Topic] = {}

    def add(self, topic: str, seq: int, now: float) -> None:
        """A datagram came.

        :param topic: one of those that the robot subscribes to
        :param seq: from its header, 0 .. 2^32 - 1
        :param now: by a steady clock [s]
        """
        known = self._topics.get(topic)
        if known is None or not known.add(seq, now):
            known = self._topics[topic] = _Topic(seq)
            known.add(seq, now)
        known.forget(now)

    def loss(self, now: float) -> Optional[float]:
        """The ratio, 0..1; None without datagrams in the window."""
        for topic in self._topics.values():
            topic.forget(now)
        counts = [topic.counts() for topic in self._topics.values()]
        expected = sum(number for _, number in counts)
        return 1 - sum(number for number, _ in counts) / expected if expected else None
