# SPDX-License-Identifier: BSD-3-Clause
"""What an operator asks of the robot: sent until it is answered, carried out once.

The ids of an operator's requests grow. The robot carries out a request only if its id is higher than all before from
that session, so neither a repeated nor a late one has any effect. A request that was made too long ago is refused: it
may have been made about another situation. Only an emergency stop is never too old.
"""
import collections
import dataclasses
import math
from typing import Deque, Optional

from .records import Wish

MAX_AGE = 1.0
"""Of a request when it comes to the robot, by the robot's clock [s]."""

MAX_AHEAD = 0.1
"""A request may seem to be made this much later than now: clocks are compared over a link that delays [s]."""

BURST = 5
"""Copies of a request"""

BURST_INTERVAL = 0.005
"""that are sent at this interval, also by a late thread within 40 ms [s];"""

INTERVAL = 0.02
"""then one at this interval until it is answered: 50 Hz [s]."""

TIMEOUT = 3.0
"""A request that is not answered for this long is given up, except for an emergency stop [s]."""

MAX_WAITING = 8
"""Requests that wait for those before them."""

MAX_OUTCOMES = 64
"""That are remembered."""

UNANSWERED = 'the robot does not answer'
SUPERSEDED = 'the emergency stop came before it'
"""Outcomes beside the robot's refusals."""


class Answers:
    """The robot's half: the requests of one operator's session."""

    def __init__(self) -> None:
        self.answered = 0
        """Id of the last request; 0: none."""
        self.refusal = ''
        """Why that was refused."""

    def take(self, request: int) -> bool:
        """Whether a request is to be carried out, and `answer` called; otherwise it is repeated or late."""
        return request > self.answered

    def answer(self, request: int, refusal: Optional[str]) -> None:
        """Keep the answer for the repetitions."""
        self.answered, self.refusal = request, refusal or ''


def untimely(made: float, now: float) -> Optional[str]:
    """Why a request is refused for the time at which it was made; None: it is not.

    :param made: by the robot's steady clock [s]; 0: unknown
    :param now: by the robot's steady clock [s]
    """
    if not made:
        return 'it is not known when it was made'
    if not now - made <= MAX_AGE:
        return 'it came %.1f s after it was made' % (now - made)
    if not made - now <= MAX_AHEAD:
        return "it was made %.1f s from now, by the operator's estimate of the robot's clock" % (made - now)
    return None


@dataclasses.dataclass
class Pending:
    """A request that waits for its answer."""
    id: int
    wish: Wish
    robot: int
    """Session of the robot's node that was known; 0: unknown."""
    made: float
    """By the robot's clock [s]; 0: unknown."""
    asked: float
    """By this clock [s]."""
    due: float
    """When it is sent next [s]."""
    copies: int = 0
    """That were sent."""


class RequestClient:
    """The operator's half: one request after the other, except that an emergency stop supersedes all others.

    Times are by the operator's steady clock [s], where nothing else is said.
    """

    def __init__(self) -> None:
        self._waiting: Deque[Pending] = collections.deque()     # the first one is sent
        self._outcomes: collections.OrderedDict[int, str] = collections.OrderedDict()
        self._last = 0

    @property
    def pending(self) -> Optional[Pending]:
        """The request that is sent until it is answered."""
        return self._waiting[0] if self._waiting else None

    def ask(self, wish: Wish, robot: int, made: float, now: float) -> int:
        """Ask for something; the same as was asked last and waits is not asked twice.

        :param robot: session of the robot's node; 0: unknown
        :param made: now by the robot's clock [s]; 0: unknown
        :return: id of the request, see `outcome`
        :raises ValueError: where too many wait
        """
        if self._waiting and self._waiting[-1].wish == wish and self._waiting[-1].robot == robot:
            return self._waiting[-1].id
        if wish == Wish.ENGAGE_ESTOP:
            while self._waiting:
                self._end(SUPERSEDED)
        if len(self._waiting) >= MAX_WAITING:
            raise ValueError('%d requests wait for the robot already' % MAX_WAITING)
        self._last += 1
        self._waiting.append(Pending(self._last, wish, robot, made, now, now))
        return self._last

    def outcome(self, request: int) -> Optional[str]:
        """None while a request waits, '' when it was carried out, otherwise why it was not."""
        if any(pending.id == request for pending in self._waiting):
            return None
        return self._outcomes.get(request, UNANSWERED)

    def answered(self, request: int, refusal: str) -> Optional[Wish]:
        """The robot has answered a request; returns what it was if it was waited for."""
        pending = self.pending
        if pending is None or pending.id != request:
            return None
        self._end(refusal)
        return pending.wish

    def poll(self, now: float) -> Optional[Pending]:
        """The request if it is to be sent now."""
        while self._waiting and now >= self._expires():
            self._end(UNANSWERED)
        pending = self.pending
        if pending is None or now < pending.due:
            return None
        pending.copies += 1
        pending.due = max(now, pending.due + (BURST_INTERVAL if pending.copies < BURST else INTERVAL))
        return pending

    def deadline(self) -> float:
        """When `poll` has something to do [s]; infinity: nothing."""
        return min(self._waiting[0].due, self._expires()) if self._waiting else math.inf

    def _expires(self) -> float:
        first = self._waiting[0]
        return math.inf if first.wish == Wish.ENGAGE_ESTOP else first.asked + TIMEOUT

    def _end(self, outcome: str) -> None:
        self._outcomes[self._waiting.popleft().id] = outcome
        while len(self._outcomes) > MAX_OUTCOMES:
            self._outcomes.popitem(last=False)
