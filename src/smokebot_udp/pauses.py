# SPDX-License-Identifier: BSD-3-Clause
"""How long a path may be silent before it counts as cut: longer than its own pauses, as bursts of loss are no cut.

A path that is heard in time all the while counts as cut after the least time. One that was silent for longer and was
heard again has shown that it pauses: for MEMORY it is given MARGIN times the longest of these pauses.
"""
import collections
from typing import Deque, NamedTuple

MEMORY = 10.0
"""How long a pause is remembered [s]."""

MARGIN = 1.5
"""Bursts of an exponential length: in ten seconds with 100 of them, the longest takes 4.6 times the mean, and one of
1.5 times that comes once in 100 s."""

MAX_PAUSES = 64
"""That are remembered: only those which are longer than all that came later."""


class Pause(NamedTuple):
    """A silence that came to an end.

    :param ended, length: [s]
    """
    ended: float
    length: float


class Pauses:
    """The pauses of one path, and how long it may be silent therefore.

    :param least: for how long it may last where the path has not paused lately [s]
    :param most: a silence that lasts longer is a cut, and no pause [s]
    :param heard: when the path was heard last; -inf: never [s]
    """

    def __init__(self, least: float, most: float, heard: float) -> None:
        self._least, self.most, self.heard = least, most, heard
        self._pauses: Deque[Pause] = collections.deque(maxlen=MAX_PAUSES)

    def hear(self, when: float, now: float) -> None:
        """The path carried something.

        :param when: when it did; no later than `now`, when this became known [s]
        """
        length = now - self.heard
        if self._least < length <= self.most:
            while self._pauses and self._pauses[-1].length <= length:
                self._pauses.pop()
            self._pauses.append(Pause(now, length))
        self.heard = max(self.heard, when)

    def limit(self, now: float) -> float:
        """How long it may be silent [s]."""
        while self._pauses and now - self._pauses[0].ended >= MEMORY:
            self._pauses.popleft()
        longest = self._pauses[0].length if self._pauses else 0.0
        return min(max(self._least, MARGIN * longest), max(self._least, self.most))

    def ends(self, now: float) -> float:
        """When it counts as cut, if it is not heard before [s]."""
        return self.heard + self.limit(now)

    def is_cut(self, now: float) -> bool:
        """Whether it has been silent for too long."""
        return now >= self.ends(now)
