# SPDX-License-Identifier: BSD-3-Clause
"""Which copies of commands take effect on the robot. Everything else is refused and counted by reason.

A copy takes effect if all of this holds:

- It was made for this session of the robot's node, carries a message of the expected type, and is not too long.
- Its operator drives, the emergency stop is not engaged, and it was made after both became so, by an operator who knew
  of the stop's last release, and after the machine was suspended last.
- Its age, by the robot's clock, is at most `max_age` even if its stamp has the largest error that it admits. A stamp
  of the future is refused as well: no honest clock gives one, and it would prolong the command's life.
- No copy of it or of a newer command took effect. Numbers compare in serial arithmetic (RFC 1982). A copy that was
  certainly made after the newest one took effect is newer whatever its number: a forged number far ahead does not
  shut out the operator, and numbers may wrap, or jump after an outage.
- The clock does not step back. If it does, nothing takes effect until it has caught up.

The gate remembers one command, of the operator who drives. What was made before a change of the driver is refused, and
what was made after it is newer, so nothing has to be remembered of the others.
"""
import collections
from typing import Counter, NamedTuple, Optional

from ..checksum import typed_checksum
from .command_copy import MAX_COMMAND_SIZE, MICROSECONDS, Copy
from .steady import STEP

TOLERANCE = 1e-3
"""By which a stamp may lie in the future beyond its uncertainty: clocks are read late [s]."""

MAX_AHEAD = 1 << 31
"""A number that is ahead by less is newer (RFC 1982, section 3.2)."""


class Accepted(NamedTuple):
    """A command that takes effect."""
    data: bytes
    """The serialised message."""
    age: float
    """Time since it was made, as far as known; an error of the stamp may make it negative [s]."""


class CommandGate:
    """Decides for each copy whether it takes effect. All times `now` are the robot's steady clock [s].

    :param robot: session of the robot's node
    :param md5sum: of the type of the messages
    :param max_age: of a command that takes effect [s]; may be changed
    """

    def __init__(self, robot: int, md5sum: str, max_age: float) -> None:
        self.max_age = max_age
        self.accepted = 0
        """Number of commands that took effect."""
        self.dropped: Counter[str] = collections.Counter()
        """Refused copies by reason. With loss, 'repeated' and 'older than a newer one' are no fault."""
        self._robot, self._md5sum = robot, md5sum
        self._driver, self._estop, self._releases, self._since = 0, False, 0, 0.0
        self._newest: Optional[int] = None      # number of the command that took effect last
        self._took_effect = 0.0
        self._latest = 0.0                      # the latest `now`

    def rule(self, driver: int, estop: bool, releases: int, now: float) -> None:
        """Say who may command from now on. A change makes all commands that were made before it void.

        :param driver: session of the operator who drives; 0: nobody
        :param estop: whether the emergency stop is engaged
        :param releases: how often it was released
        """
        self._latest = max(self._latest, now)
        if (driver, estop, releases) != (self._driver, self._estop, self._releases):
            self._driver, self._estop, self._releases, self._since = driver, estop, releases, self._latest

    def void(self, now: float) -> None:
        """All commands that were made until now are void: they may have waited while the machine was suspended."""
        self._latest = max(self._latest, now)
        self._since = self._latest

    def take(self, copy: Copy, now: float) -> Optional[Accepted]:
        """A copy was received; returns the command if it takes effect. Nothing is raised."""
        if now < self._latest - STEP:
            self._since = self._latest      # of what was made before, nobody knows the age
            self.dropped['clock went back'] += 1
            return None
        now = self._latest = max(self._latest, now)
        reason = (self._foreign(copy) or self._not_allowed(copy) or self._not_newer(copy)
                  or self._not_in_time(copy, now))
        if reason is not None:
            self.dropped[reason] += 1
            return None
        self._newest, self._took_effect = copy.number, now
        self.accepted += 1
        return Accepted(bytes(copy.data), now - copy.made / MICROSECONDS)

    def _foreign(self, copy: Copy) -> Optional[str]:
        """Why it is no command for this node."""
        if copy.robot != self._robot:
            return 'another session'
        if len(copy.data) > MAX_COMMAND_SIZE:
            return 'too long'
        return None if copy.checksum == typed_checksum(self._md5sum, copy.data) else 'type'

    def _not_allowed(self, copy: Copy) -> Optional[str]:
        """Why its operator may not command, or could not when it was made."""
        if self._estop:
            return 'emergency stop'
        if not self._driver or copy.session != self._driver:
            return 'not in control'
        known = copy.releases == self._releases
        return None if known and _earliest(copy) > self._since + TOLERANCE else 'made before control'

    def _not_newer(self, copy: Copy) -> Optional[str]:
        """Why it is superseded."""
        if self._newest is None or _earliest(copy) > self._took_effect + TOLERANCE:
            return None
        if copy.number == self._newest:
            return 'repeated'
        return None if (copy.number - self._newest) % (2 * MAX_AHEAD) < MAX_AHEAD else 'older than a newer one'

    def _not_in_time(self, copy: Copy, now: float) -> Optional[str]:
        """Why its age is not within its life."""
        made, uncertainty = copy.made / MICROSECONDS, copy.uncertainty / MICROSECONDS
        if uncertainty > self.max_age:
            return 'uncertain clock'
        if made - uncertainty > now + TOLERANCE:
            return 'from the future'
        return 'too old' if now - (made - uncertainty) > self.max_age else None


def _earliest(copy: Copy) -> float:
    """When it was made at the earliest, by the robot's clock [s]."""
    return (copy.made - copy.uncertainty) / MICROSECONDS
