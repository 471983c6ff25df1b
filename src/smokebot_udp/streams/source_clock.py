# SPDX-License-Identifier: BSD-3-Clause
"""What the stamps of a source are good for: they identify its messages, and say how old these are.

A camera may count from its own start, a machine's clock may be wrong, a recording is of another day: such stamps are in
another epoch. A driver may stamp with whole seconds, or with nothing that changes. Then the time at which a message
came to robot_sender crosses with it: it identifies the message, and its age counts from there.

A message that is really old must not look fresh. So an epoch is another one only where a source begins with it, or
jumps by more than any driver falls behind, and goes on at the pace of its stamps, which a backlog that is worked off
does not.
"""
import collections
from typing import Deque, List, NamedTuple, Optional

LEAST_AGE, MOST_AGE, LATEST = -0.1, 30.0, 3600.0
"""How old messages may be when they come, by stamps of this epoch: at the beginning, and where messages that were good
enough came before. A clock is off by less than the first of these [s]."""

PROOF, PACE = 5, 2.0
"""Messages in a row that prove an epoch; of another one they take at most so many times what their stamps say, and at
least that part."""

REPEATS, MEMORY = 3, 60.0
"""A source whose stamp did not grow so often within this time repeats its stamps for good [1, s]."""

RESTART = 2.0
"""A stamp that goes back by more is of a new epoch, not a repeated one [s]."""

S = 10 ** 9
"""[ns]"""

OTHER_EPOCH = ('its stamps are of another epoch, %.1f s before they come: the age of its messages counts from their '
               'arrival here')
REPEATED = 'it repeats its stamps: its messages are told apart by their arrival here, from which their age counts'


class _Message(NamedTuple):
    stamp: float
    """[s]"""
    arrival: float
    """[s]"""

    @property
    def age(self) -> float:
        """By the stamp [s]."""
        return self.arrival - self.stamp


class Epoch:
    """Whether the stamps of a source are of another epoch than that of a clock."""

    def __init__(self) -> None:
        self.other = False
        self._messages: Deque[_Message] = collections.deque(maxlen=PROOF)  # the last ones
        self._most_age = MOST_AGE

    def look(self, stamp: int, arrival: int) -> bool:
        """Take the stamp of the next message, and when it came, by the clock [ns]: whether `other` has become true."""
        self._messages.append(_Message(stamp / S, arrival / S))
        if len(self._messages) < PROOF:
            return False
        good = [LEAST_AGE <= one.age <= self._most_age for one in self._messages]
        if all(good):
            self.other, self._most_age = False, LATEST
        elif not any(good) and not self.other and self._at_pace():
            self.other, self._most_age = True, MOST_AGE
            return True
        return False

    def _at_pace(self) -> bool:
        """Whether the last messages came about as their stamps say."""
        first, last = self._messages[0], self._messages[-1]
        by_stamp, took = last.stamp - first.stamp, last.arrival - first.arrival
        return 0 < by_stamp <= PACE * took and took <= PACE * by_stamp


class SourceClock:
    """Follows the messages of one source."""

    def __init__(self) -> None:
        self._epoch, self._repeated = Epoch(), False
        self._last: Optional[int] = None                            # stamp [ns]
        self._repeats: Deque[int] = collections.deque(maxlen=REPEATS)   # when they came [ns]
        self._arrival = 0                                           # of the last message, as given [ns]

    def take(self, stamp: int, arrival: int, warnings: List[str]) -> int:
        """Take the next message.

        :param stamp: of the source [ns]
        :param arrival: when the message came, by the clock of this epoch [ns]
        :param warnings: to be added to
        :return: when it came, where that has to cross, another time for each message [ns]; 0: its stamp is good enough
        :raises ValueError: it cannot be told from the one before, and this source does not repeat its stamps for good
        """
        if self._epoch.look(stamp, arrival):
            warnings.append(OTHER_EPOCH % ((arrival - stamp) / S))
        self._look_at_repeats(stamp, arrival, warnings)
        last, self._last = self._last, stamp
        if self._epoch.other or self._repeated:
            self._arrival = max(arrival, self._arrival + 1)
            return self._arrival
        if stamp == last:
            raise ValueError("its stamp is %d.%09d like the last one's: they cannot be told apart" % divmod(stamp, S))
        return 0

    def _look_at_repeats(self, stamp: int, arrival: int, warnings: List[str]) -> None:
        if self._last is not None and self._last - RESTART * S < stamp <= self._last:
            self._repeats.append(arrival)
        repeated = len(self._repeats) == REPEATS and arrival - self._repeats[0] <= MEMORY * S
        if repeated and not self._repeated:
            warnings.append(REPEATED)
        self._repeated = repeated
