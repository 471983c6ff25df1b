# SPDX-License-Identifier: BSD-3-Clause
"""The robot's half of control: who is present, who drives, the emergency stop, and the status that tells all of them.

Call `poll` after every other method and at `deadline`, and send the status that it returns to all operators.
"""
import collections
import dataclasses
import math
from typing import Any, Counter, Dict, List, Optional, Tuple

from ..newest import Newest
from .control import Control
from .estop import EstopLatch
from .loss import LossMeter
from .records import MAX_OTHERS, PeerStatus, Request, Status, Wish
from .requests import Answers, untimely
from .sessions import LEASE

PERIOD, IDLE_PERIOD = 0.2, 0.5
"""Interval of the status: while commands come and until LEASE after a request or a change; and otherwise [s]."""

MIN_INTERVAL = 0.01
"""Minimum interval of the status. A change and a request are answered at once, but no faster than this [s]."""

EMERGENCY_STOP = 'emergency stop'
NOT_IN_CONTROL = 'not in control'
NO_OPERATOR = 'no operator'
"""Reasons to refuse a command; `dropped` counts why its sender is no operator."""

REQUESTS, REPORTS = 'requests', 'reports'
"""The topics of requests and of link reports for LossMeter."""

MAX_SESSIONS = 64
"""Maximum number of sessions that are remembered, including those that have ended."""

TELLING = 2.0
"""Time after a copy of a request for which its sender is told the answer, if it is no operator [s]."""


@dataclasses.dataclass
class _Peer:
    """One session of an operator."""
    heard: float
    """When a datagram of it came last [s]."""
    clock: float = 0.0
    """Time of the session's newest request, by the operator's clock [s]."""
    came: float = 0.0
    """When the newest request came [s]."""
    loss: LossMeter = dataclasses.field(default_factory=LossMeter)


class ControlServer:
    """Serves all operators. Times are by the robot's steady clock [s].

    :param session: of this node: a random number other than 0
    """

    def __init__(self, session: int) -> None:
        self.session = session
        self.control, self.estop = Control(), EstopLatch()
        self.dropped: Counter[str] = collections.Counter()
        """{reason: count} of the datagrams of those who are no operators."""
        self._peers: Dict[Tuple[str, int], _Peer] = {}      # {(name, session): of it}
        self._answers: Newest[Tuple[str, int], Answers] = Newest(MAX_SESSIONS)     # of who has asked
        self._sent = -math.inf      # when the status was sent last
        self._busy = -math.inf      # when a command, a request or a change came last
        self._prompted = True       # whether it is to be sent at once
        self._told: Any = None      # what it told

    @property
    def remembered(self) -> int:
        """Sessions that are remembered."""
        return max(len(self._peers), len(self._answers))

    def receive(self, name: str, seq: int, request: Request, now: float) -> None:
        """Take an operator's request.

        :param name: of its node, as the transport knows it
        :param seq: of the message's header
        """
        stranger = self._heard(name, request.session, REQUESTS, seq, now)
        if stranger is None:
            peer = self._peers[name, request.session]
            if request.clock > peer.clock:
                peer.clock, peer.came = request.clock, now
        if request.id:
            self._prompted, self._busy = True, now
            answers = self._answers.of((name, request.session), Answers)    # whether of an operator or not
            answers.asked = now
            if answers.take(request.id):
                answers.answer(request.id, self._carry_out(name, request, stranger, now))

    def command(self, name: str, session: int, topic: str, seq: int, now: float) -> Optional[str]:
        """A command came; its operator's lease is renewed.

        :param topic: that it came by
        :param seq: of the message's header
        :return: None, or why its operator may not drive now
        """
        if self._heard(name, session, topic, seq, now) is not None:
            return NO_OPERATOR
        self._busy = now
        if self.estop.engaged:
            return EMERGENCY_STOP
        driver = self.control.driver
        return None if driver is not None and driver.name == name else NOT_IN_CONTROL

    def reported(self, name: str, seq: int, now: float) -> None:
        """A link report of an operator came.

        :param seq: of the message's header
        """
        self.control.renew(name, now)
        peer = next((self._peers[key] for key in self._present() if key[0] == name), None)
        if peer is not None:
            peer.loss.add(REPORTS, seq, now)

    def left(self, name: str) -> None:
        """An operator's link has ended."""
        self.control.left(name)

    def set_estop(self, engaged: bool, by: str, now: float) -> None:
        """A person at the robot engages or releases the emergency stop."""
        self.estop.set_locally(engaged, by, now)

    def operators(self, now: float) -> List[PeerStatus]:
        """What is known of those that are present."""
        return [PeerStatus(session, name, peer.clock, now - peer.came if peer.clock else 0.0, answers.answered,
                           answers.refusal, peer.loss.loss(now))
                for name, session in self._present() for peer, answers in (
                    (self._peers[name, session], self._answers.get((name, session), Answers())),)]

    def others(self, now: float) -> List[PeerStatus]:
        """The answers to those that are no operators, who may all the same engage the emergency stop."""
        present = self._present()
        asking = [PeerStatus(session, name, 0.0, 0.0, answers.answered, answers.refusal)
                  for (name, session), answers in self._answers.items()
                  if now - answers.asked < TELLING and (name, session) not in present]
        return asking[-MAX_OTHERS:]

    def deadline(self) -> float:
        """When `poll` has something to do [s]."""
        lease = self.control.deadline()
        return min(self._due(), math.inf if lease is None else lease)

    def poll(self, now: float) -> Optional[Status]:
        """Let leases end; returns the status if it is to be sent now."""
        self.control.poll(now)
        if now < self._due():
            return None
        driver, news = self.control.driver, self._news()
        if news != self._told:
            self._busy = now
        self._sent, self._prompted, self._told = now, False, news
        return Status(self.session, now, driver.name if driver else '', driver.session if driver else 0,
                      self.estop.engaged, self.estop.by, self.estop.releases, tuple(self.operators(now)),
                      tuple(self.others(now)))

    def _due(self) -> float:
        if self._prompted or self._news() != self._told:
            return self._sent + MIN_INTERVAL
        return self._sent + (PERIOD if self._sent < self._busy + LEASE else IDLE_PERIOD)

    def _news(self) -> Any:
        """What operators are told at once where it changes."""
        driver = self.control.driver
        return (driver and (driver.name, driver.session), self.estop.engaged, self.estop.by, self.estop.releases,
                self._present())

    def _heard(self, name: str, session: int, topic: str, seq: int, now: float) -> Optional[str]:
        """Why a datagram comes from no operator, which is counted; None: it comes from one of `_peers`."""
        refusal = self.control.heard(name, session, now)
        if refusal is not None:
            self.dropped[refusal] += 1
            return refusal
        peer = self._peers.setdefault((name, session), _Peer(now))
        peer.heard = now
        peer.loss.add(topic, seq, now)
        self._forget(now)
        return None

    def _forget(self, now: float) -> None:
        """Forget sessions that have ended."""
        present = set(self._present())
        for key, peer in list(self._peers.items()):
            if key not in present and (now - peer.heard > LEASE or len(self._peers) > MAX_SESSIONS):
                del self._peers[key]

    def _present(self) -> List[Tuple[str, int]]:
        """(name, session) of the operators that are present."""
        return [(operator.name, operator.session) for operator in self.control.operators]

    def _carry_out(self, name: str, request: Request, stranger: Optional[str], now: float) -> Optional[str]:
        """Carry out a request; returns None, or why it is refused.

        :param stranger: why it comes from no operator; None: it comes from one
        """
        if request.wish == Wish.ENGAGE_ESTOP:   # anybody may, even one too many
            self.estop.engage(name, now)
            return None
        refusal = stranger or ('' if request.robot == self.session else 'the robot was restarted')
        if refusal:
            return refusal
        if request.wish == Wish.RELEASE_ESTOP:
            return self.estop.release(request.made, now)
        late = untimely(request.made, now)
        if late is not None:
            return late
        return self.control.take(name) if request.wish == Wish.TAKE_CONTROL else self.control.release(name)
