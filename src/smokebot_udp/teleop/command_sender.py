# SPDX-License-Identifier: BSD-3-Clause
"""Sends each of an operator's commands several times within its life, until a newer one replaces it.

Nothing is acknowledged: an acknowledgement would come after half the life of a command. Copies are spread over time
because a link loses datagrams in bursts, closer at first because a fresh command is worth most. Their number within
REACH follows from the link's loss: all of them are lost with the probability MISS at most, as far as the bound of 200
copies a second permits. The gaps grow in proportion to the age of the command, so a command that is not replaced, such
as the last one before its source falls silent, is sent until it expires at little cost. A stop is a command like any
other here; it gets all of this.

=====  ======================  ======================  =======================================
 loss  gaps                    copies/s of a source    probability that REACH brings no copy,
       within REACH            at 20 Hz                if losses are independent
=====  ======================  ======================  =======================================
  0 %  16 to 49 ms             60                      0
 20 %  7 to 20 ms              107                     6e-5
 50 %  2.5 to 8 ms             200                     6e-5
 80 %  2.5 to 8 ms             200                     0.04
=====  ======================  ======================  =======================================
"""
import math
from typing import Optional

from ..checksum import typed_checksum
from ..copies import copies
from .command_copy import MAX_COMMAND_SIZE, MICROSECONDS, Copy
from .robot_clock import RobotTime

REACH = 0.06
"""Time within which a copy is to arrive, the way itself excluded: one period of a source at 20 Hz and 20 ms, less
10 ms for the threads of both nodes and the jitter of the link [s]."""

MISS = 3e-4
"""Accepted probability that no copy of those within REACH arrives, if their losses are independent."""

MARGIN = 0.05
"""The loss may exceed the measured one by this: two standard deviations of 400 datagrams at 50 %, and what changes
until the robot reports it."""

UNKNOWN_LOSS = 0.5
"""Assumed until the robot has reported the loss."""

MEAN_GAP = 0.005
"""Minimum mean interval of all copies: at most 200 leave in a second, whatever the rate of the source [s]."""

BURST = 4
"""Number of copies that may leave earlier than MEAN_GAP permits on average."""

MAX_GAP = 0.2
"""Maximum interval between two copies of a command that is valid for long: at least 5 leave in a second [s]."""

EARLY = 0.5
"""The first gap of a command as a ratio of its mean gap; it grows by one mean gap each REACH."""

NUMBERS = 1 << 32
"""Number of different command numbers. After the highest one they begin again with 0."""


def copy_gap(loss: Optional[float], age: float) -> float:
    """Time from a copy of a command to the next one [s].

    :param loss: of the link's datagrams, 0..1; None and what is no loss: unknown
    :param age: of the command [s]
    """
    if loss is None or not 0 <= loss <= 1:
        loss = UNKNOWN_LOSS
    count = copies(loss + MARGIN, MISS)
    # a gap of mean * (EARLY + age / REACH) gives REACH / mean * log(1 / EARLY + 1) gaps within REACH
    mean = max(MEAN_GAP, REACH * math.log(1 / EARLY + 1) / (count - 1))
    return min(MAX_GAP, mean * (EARLY + age / REACH))


class CommandSender:
    """Decides when which copy of a command is sent. All times `now` are the operator's steady clock [s].

    :param session: of the operator's node
    :param md5sum: of the type of the messages
    :param max_age: life of a command [s]; may be changed
    """

    def __init__(self, session: int, md5sum: str, max_age: float) -> None:
        self.max_age = max_age
        self.loss: Optional[float] = None
        """Loss of the link's datagrams as the robot reports it, 0..1; None, or no possible loss: unknown."""
        self._session, self._md5sum = session, md5sum
        self._copy: Optional[Copy] = None
        self._number = 0
        self._made = self._uncertainty = 0.0    # of the newest command
        self._due = 0.0                         # its next copy
        self._free = 0.0                        # when MEAN_GAP permits the next copy of any command

    def accepts(self, time: Optional[RobotTime]) -> bool:
        """Whether the robot could take a command that is made now: not if its stamp may be wrong by all of its life.

        :param time: the robot's, now; None: unknown
        """
        return time is not None and time.uncertainty / MICROSECONDS < self.max_age

    def put(self, data: bytes, made: RobotTime, releases: int, now: float) -> None:
        """A new command replaces the last one; its first copy is due at once.

        :param data: the serialised message
        :param made: the robot's time at `now`
        :param releases: of the emergency stop, as far as they are known
        :raises ValueError: if it is longer than MAX_COMMAND_SIZE; the last command is withdrawn then
        """
        self.withdraw()
        if len(data) > MAX_COMMAND_SIZE:
            raise ValueError('it has %d bytes; a command must have %d at most' % (len(data), MAX_COMMAND_SIZE))
        self._number = (self._number + 1) % NUMBERS
        self._copy = Copy(self._session, made.robot, self._number, made.made, made.uncertainty, releases,
                          typed_checksum(self._md5sum, data), data)
        self._made, self._uncertainty = now, made.uncertainty / MICROSECONDS
        self._free = min(self._free, now + MEAN_GAP)    # a clock that went back delays nothing
        self._due = max(now, self._free)

    def withdraw(self) -> None:
        """No further copy is sent before the next command: the operator may not command, or the clock is lost."""
        self._copy = None

    def deadline(self) -> Optional[float]:
        """When to call `poll` [s]; None: not before the next command."""
        return self._due if self._copy is not None else None

    def poll(self, now: float) -> Optional[Copy]:
        """The copy to send now; None: there is none."""
        age = now - self._made
        if age + self._uncertainty > self.max_age:
            self.withdraw()     # the robot refuses what could be older
        if self._copy is None or now < self._due:
            return None
        self._free = max(self._free, now - BURST * MEAN_GAP) + MEAN_GAP
        self._due = max(self._due + copy_gap(self.loss, age), self._free, now)
        return self._copy
