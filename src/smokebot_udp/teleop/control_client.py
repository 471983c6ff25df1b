# SPDX-License-Identifier: BSD-3-Clause
"""An operator's half of control: its presence, what it asks of the robot, and what it knows of the robot.

Call `poll` after every other method and at `deadline`, and send the request that it returns.
"""
import math
from typing import Optional, Sequence

from .estop import EstopClient
from .records import MAX_OPERATORS, PeerStatus, Request, Status, Wish
from .requests import RequestClient
from .sessions import LEASE, LivingSession

PERIOD, IDLE_PERIOD = 0.2, 0.5
"""At which the operator shows its presence, and asks for the robot's clock, during an emergency stop and otherwise [s].
Link reports and commands show its presence, too."""

STATUS_LEASE = 5.0
"""While other datagrams of the robot come, the last status is in force for this long [s]."""


class ControlClient:
    """Speaks with one robot. Times are by the operator's steady clock [s], where nothing else is said.

    :param session: of this node: a random number other than 0
    """

    def __init__(self, session: int) -> None:
        self.session = session
        self.status: Optional[Status] = None
        """The newest one of the robot."""
        self.alive = -math.inf
        """When any datagram of the robot came last."""
        self._came = self._shown = -math.inf    # when the status came, and when presence was shown last
        self._robot = LivingSession()
        self._requests = RequestClient()
        self._estop = EstopClient(self._requests)

    @property
    def robot(self) -> int:
        """Session of the robot's node; 0: unknown."""
        return self.status.session if self.status else 0

    @property
    def own(self) -> Optional[PeerStatus]:
        """What the robot knows of this operator; None: it did not list it in its newest status."""
        return self._of_this(self.status.operators) if self.status else None

    @property
    def loss(self) -> Optional[float]:
        """Ratio of this operator's datagrams that do not arrive, 0..1; None: unknown."""
        own = self.own      # once: another thread may take a status meanwhile that does not list this operator
        return own.loss if own else None

    def receive(self, status: Status, now: float) -> bool:
        """Take a status; returns whether it is news: not late, nor of a node that the robot had before."""
        own = self._of_this(status.operators)
        if not self._robot.take(status.session, now, own is not None and now - own.echo <= LEASE):
            return False
        if self.status and self.status.session == status.session and status.clock <= self.status.clock:
            return False
        self.status, self._came = status, now
        answer = own or self._of_this(status.others)
        if answer is not None:
            wish = self._requests.answered(answer.answered, answer.refusal)
            if wish is not None:
                self._estop.answered(wish, answer.refusal, status.session)
        self._estop.heard(status, answer.name if answer else '', now)
        return True

    def ask(self, wish: Wish, now: float, robot_time: Optional[float]) -> int:
        """Ask something of the robot.

        :param robot_time: the earliest that it may be now by the robot's steady clock [s]; None: unknown. Only an
            emergency stop needs none
        :return: id of the request, see `outcome`
        :raises ValueError: where it cannot be asked now; nothing is asked then
        """
        if wish == Wish.ENGAGE_ESTOP:
            return self._estop.engage(now)
        if not self.heard(now):
            raise ValueError(self._silence(now))
        if robot_time is None:
            raise ValueError("the robot's clock is not known yet")
        return self._requests.ask(wish, self.robot, robot_time, now)

    def outcome(self, request: int) -> Optional[str]:
        """None while a request waits for its answer, '' when it was carried out, otherwise why it was not."""
        return self._requests.outcome(request)

    def heard(self, now: float) -> bool:
        """Whether the link is up: a status came within the lease, or something else did after a recent status."""
        return now - self._came < (STATUS_LEASE if now - self.alive < LEASE else LEASE)

    def in_control(self, now: float) -> bool:
        """Whether this operator drives, as far as it knows."""
        return self.heard(now) and self.status is not None and self.status.driver_session == self.session

    @property
    def estop(self) -> bool:
        """Whether the emergency stop is engaged, as far as it is known, or this operator wants it to be."""
        return self._estop.wanted or (self.status is not None and self.status.estop)

    def refusal(self, now: float) -> str:
        """Why the robot does not take this operator's commands, as far as it is known; empty: it does."""
        if self.status is None or not self.heard(now):
            return self._silence(now)
        if self.estop:
            return 'emergency stop by %s' % (self.status.estop_by if self.status.estop else 'this operator')
        if self.own is None:
            full = len(self.status.operators) >= MAX_OPERATORS
            return 'too many operators' if full else 'the robot does not hear this operator'
        if self.status.driver_session != self.session:
            return '%s drives' % self.status.driver if self.status.driver else 'nobody drives'
        return ''

    def deadline(self) -> float:
        """When `poll` has something to do [s]."""
        return min(self._presence_due(), self._requests.deadline())

    def poll(self, now: float) -> Optional[Request]:
        """The request that is to be sent now, if any."""
        pending = self._requests.poll(now)
        if pending is None and now < self._presence_due():
            return None
        self._shown = now
        if pending is None:
            return Request(self.session, now, self.robot)
        return Request(self.session, now, pending.robot, pending.id, pending.wish, pending.made)

    def _presence_due(self) -> float:
        """A robot that was restarted has to hear soon that the emergency stop is engaged."""
        return self._shown + (PERIOD if self.estop else IDLE_PERIOD)

    def _of_this(self, peers: Sequence[PeerStatus]) -> Optional[PeerStatus]:
        return next((peer for peer in peers if peer.session == self.session), None)

    def _silence(self, now: float) -> str:
        if self.status is None:
            return 'the robot was not heard yet'
        return 'the robot was not heard for %.1f s' % (now - self._came)
