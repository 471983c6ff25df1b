# SPDX-License-Identifier: BSD-3-Clause
"""What an operator asks of the robot: sent until it is answered, carried out once.

The ids of an operator's requests grow. The robot carries out a request only if its id is higher than all before from
that session, so neither a repeated nor a late one has any effect. A request that was made too long ago is refused: it
may have been made about another situation. Only an emergency stop is never too old.

Whoever asks for the same once more means it once more: the situation may have changed since, unheard. So each asking
has an id and a time of its own, also while the one before waits for its answer.
"""
import collections
import dataclasses
import math
from typing import Deque, Optional, Tuple

from ..newest import Newest
from .records import Wish

MAX_AGE = 1.0
"""Maximum age of a request when it arrives at the robot, by the robot's clock [s]."""

MAX_AHEAD = 0.1
"""Time by which a request may seem to be made in the future: clocks are compared over a link that delays [s]."""

BURST = 5
"""Number of copies of a request that are sent at BURST_INTERVAL."""

BURST_INTERVAL = 0.005
"""Interval of the first BURST copies of a request. A late thread, too, sends all of them within 40 ms [s]."""

INTERVAL = 0.02
"""Interval of the further copies of a request until it is answered: 50 Hz [s]."""

TIMEOUT = 3.0
"""Time without an answer after which a request is given up, except for an emergency stop [s]."""

MAX_OUTCOMES = 64
"""Maximum number of outcomes that are remembered."""

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
        self.asked = 0.0
        """When a copy of a request came last, by the robot's steady clock [s]."""

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
    replaced: Tuple[int, ...] = ()
    """Ids of the same wish asked before, whose outcome is this one's."""
    copies: int = 0
    """Number of copies that were sent."""


class RequestClient:
    """The operator's half: one request after the other, except that an emergency stop supersedes all others.

    Times are by the operator's steady clock [s], where nothing else is said.
    """

    def __init__(self) -> None:
        self._waiting: Deque[Pending] = collections.deque()     # of each wish one at most; the first one is sent
        self._outcomes: Newest[int, str] = Newest(MAX_OUTCOMES)
        self._last = 0

    @property
    def pending(self) -> Optional[Pending]:
        """The request that is sent until it is answered."""
        return self._waiting[0] if self._waiting else None

    def ask(self, wish: Wish, robot: int, made: float, now: float) -> int:
        """Ask for something. It takes the place of the same wish that waits, and an emergency stop of all others.

        :param robot: session of the robot's node; 0: unknown
        :param made: now by the robot's clock [s]; 0: unknown
        :return: id of the request, see `outcome`
        """
        replaced: Tuple[int, ...] = ()
        same = next((pending for pending in self._waiting if pending.wish == wish), None)
        if same is not None:
            self._waiting.remove(same)
            replaced = (*same.replaced, same.id)[-MAX_OUTCOMES:]
        while self._waiting and wish == Wish.ENGAGE_ESTOP:
            self._end(SUPERSEDED)
        self._last += 1
        self._waiting.append(Pending(self._last, wish, robot, made, now, now, replaced))
        return self._last

    def outcome(self, request: int) -> Optional[str]:
        """None while a request waits, '' when it was carried out, otherwise why it was not."""
        if any(request in (pending.id, *pending.replaced) for pending in self._waiting):
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
        ended = self._waiting.popleft()
        for request in (*ended.replaced, ended.id):
            self._outcomes[request] = outcome
