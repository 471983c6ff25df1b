# SPDX-License-Identifier: BSD-3-Clause
"""Who drives the robot.

* An operator is present from its first datagram until its link ends or it was not heard for LEASE.
* A sole operator holds control without asking, unless it has released it.
* With several, the one who holds control keeps it until it releases it, is gone, or another one takes it: at once, even
  if the holder is still there. After a release nobody drives until somebody takes control.
* Who is gone and comes back is a newcomer.
* A node that was restarted keeps the place that it had under its name.
"""
import dataclasses
from typing import Dict, List, Optional

from .records import MAX_OPERATORS
from .sessions import LEASE, LivingSession

FORMER_SESSION = 'another session'
TOO_MANY = 'too many operators'
NOT_PRESENT = 'not present'
"""Reasons to refuse."""


@dataclasses.dataclass
class Operator:
    """An operator that is present."""
    name: str
    living: LivingSession
    heard: float
    """When it was heard last [s]."""
    released: bool = False
    """Whether it has released control since it came or took it last."""

    @property
    def session(self) -> int:
        """Session of the operator's node."""
        return self.living.current


class Control:
    """Decides who drives. Times are by the robot's steady clock [s]."""

    def __init__(self) -> None:
        self._operators: Dict[str, Operator] = {}
        self._driver: Optional[str] = None

    @property
    def operators(self) -> List[Operator]:
        """Those that are present, in the order in which they came."""
        return list(self._operators.values())

    @property
    def driver(self) -> Optional[Operator]:
        """Who drives; None: nobody."""
        return None if self._driver is None else self._operators[self._driver]

    def heard(self, name: str, session: int, now: float) -> Optional[str]:
        """A datagram came from an operator: it is present, and its lease begins anew.

        :param name: of its node, as the transport knows it
        :return: None, or why it is none: FORMER_SESSION or TOO_MANY
        """
        self.poll(now)
        operator = self._operators.get(name)
        if operator is None:
            if len(self._operators) >= MAX_OPERATORS:
                return TOO_MANY
            operator = self._operators[name] = Operator(name, LivingSession(), now)
        before = operator.session
        if not operator.living.take(session, now):
            return FORMER_SESSION
        operator.heard = now
        operator.released = operator.released and operator.session == before
        self._settle()
        return None

    def renew(self, name: str, now: float) -> None:
        """A datagram without a session came from an operator, such as a link report."""
        self.poll(now)
        if name in self._operators:
            self._operators[name].heard = now

    def left(self, name: str) -> None:
        """An operator's link has ended."""
        self._operators.pop(name, None)
        if self._driver == name:
            self._driver = None
        self._settle()

    def take(self, name: str) -> Optional[str]:
        """An operator takes control; returns None, or why it does not."""
        if name not in self._operators:
            return NOT_PRESENT
        self._operators[name].released = False
        self._driver = name
        return None

    def release(self, name: str) -> Optional[str]:
        """An operator releases control; returns None, or why it does not."""
        if name not in self._operators:
            return NOT_PRESENT
        if self._driver != name:
            return 'nobody drives' if self._driver is None else '%s drives' % self._driver
        self._operators[name].released = True
        self._driver = None
        return None

    def deadline(self) -> Optional[float]:
        """When `poll` has something to do, unless somebody is heard before [s]; None: never."""
        return min((operator.heard + LEASE for operator in self._operators.values()), default=None)

    def poll(self, now: float) -> None:
        """Whoever was not heard for LEASE is gone."""
        for operator in self.operators:
            if now - operator.heard >= LEASE:
                self.left(operator.name)

    def _settle(self) -> None:
        """A sole operator drives without asking."""
        if self._driver is None and len(self._operators) == 1:
            sole, = self._operators.values()
            if not sole.released:
                self._driver = sole.name
