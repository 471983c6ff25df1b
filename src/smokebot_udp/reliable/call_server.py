# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of a service: executes each call of each operator at most once. See calls.py."""
import collections
from typing import Any, Counter, Deque, Dict, Mapping, NamedTuple, Optional, OrderedDict, Set, Tuple

from .calls import (
    MAX_CALLS,
    MAX_SIZE,
    MAX_TIMEOUT,
    SLOWEST,
    WELCOME,
    Answer,
    Outcome,
    Request,
    answer_to,
    unpack_request,
)

MAX_RUNNING = 8
"""Calls of one service that are executed at the same time; further ones wait."""

MAX_OPERATORS = 16
"""Sessions of operators whose answers are kept,"""

MAX_FORMER = 1024
"""and whose last number is remembered afterwards."""

WINDOW = 1024
"""A number is refused where a call with one higher by this much was seen."""

MAX_ANSWERS, MAX_ANSWER_BYTES = 256, 1 << 19
"""That are kept of one operator; the newest is kept whatever its size."""


class Execution(NamedTuple):
    """A call that is to be executed now."""
    peer: str
    """The operator's node."""
    request: Request
    until: float
    """Nobody waits for the answer afterwards [s]."""


class _Seen:
    """The calls of one session of an operator that were seen, and the last answers."""

    def __init__(self, least: int) -> None:
        self.newest = least
        self._least = least     # numbers up to this one are refused
        self._numbers: Set[int] = set()
        self._answers: OrderedDict[int, bytes] = collections.OrderedDict()
        self._due: Dict[int, float] = {}    # when each answer may be sent again
        self._bytes = 0

    def add(self, number: int) -> bool:
        """Whether this number was not seen before."""
        if number <= self._least or number in self._numbers:
            return False
        self._numbers.add(number)
        if number > self.newest:
            self.newest = number
            self._least = max(self._least, number - WINDOW)
            self._numbers = {seen for seen in self._numbers if seen > self._least}
        return True

    def keep(self, number: int, answer: bytes, now: float) -> None:
        """Keep an answer that is sent now."""
        self._answers[number], self._due[number] = answer, now + len(answer) / SLOWEST
        self._bytes += len(answer)
        while len(self._answers) > 1 and (len(self._answers) > MAX_ANSWERS or self._bytes > MAX_ANSWER_BYTES):
            oldest, forgotten = self._answers.popitem(last=False)
            self._bytes -= len(forgotten)
            del self._due[oldest]

    def crossing(self, number: int, now: float) -> bool:
        """Whether the answer may still be on its way."""
        return self._due.get(number, now) > now

    def answer(self, number: int, now: float) -> Optional[bytes]:
        """The answer that was kept, to be sent again now."""
        if number in self._answers:
            self._due[number] = now + len(self._answers[number]) / SLOWEST
        return self._answers.get(number)


class CallServer:
    """Calls of one service by all operators. The clock is an argument [s, any steady clock].

    :param session: of this node, not 0
    :param checksum: see calls.type_checksum
    :param type_name: of the service
    """

    def __init__(self, session: int, checksum: int, type_name: str) -> None:
        self.session = session
        self.dropped: Counter[str] = collections.Counter()
        """{reason: requests that were not executed}"""
        self._checksum, self._type_name = checksum, type_name
        self._seen: OrderedDict[Tuple[str, int], _Seen] = collections.OrderedDict()    # by peer and client, newest last
        self._former: OrderedDict[Tuple[str, int], int] = collections.OrderedDict()    # their newest numbers
        self._waiting: Deque[Execution] = collections.deque()
        self._running: Dict[Tuple[str, int, int], Execution] = {}       # by peer, client and number

    @property
    def running(self) -> int:
        """The number of calls that are executed now."""
        return len(self._running)

    def overdue(self, now: float) -> int:
        """The number of calls that are executed although nobody waits for the answer any more."""
        return sum(execution.until <= now for execution in self._running.values())

    def receive(self, peer: str, data: bytes, now: float) -> Optional[bytes]:
        """Take a message of an operator; the answer to it, where it has one at once.

        :param peer: the operator's node
        """
        request = unpack_request(data)
        if request is None:
            self.dropped['malformed'] += 1
            return None
        if request.server != self.session:
            if request.server:
                self.dropped['another session'] += 1
            return Answer(request.client, self.session, request.number, now, WELCOME).pack()
        seen = self._of(peer, request.client)
        if not seen.add(request.number):
            return self._repeated(peer, request, seen, now)
        refusal = self._refusal(request)
        if refusal is None:
            self._waiting.append(Execution(peer, request, min(request.until, now + MAX_TIMEOUT)))
            return None
        return self._answer(seen, request, Outcome(failure=refusal), now)

    def take(self, now: float) -> Optional[Execution]:
        """The next call to execute; None: none waits, or MAX_RUNNING are executed."""
        while self._waiting and len(self._running) < MAX_RUNNING:
            execution = self._waiting.popleft()
            if execution.until > now:
                self._running[_key(execution)] = execution
                return execution
            self.dropped['too late'] += 1
        return None

    def finish(self, execution: Execution, outcome: Outcome, now: float) -> bytes:
        """A call that `take` gave was executed; the answer to its operator."""
        del self._running[_key(execution)]
        if len(outcome.data) > MAX_SIZE:
            outcome = Outcome(failure='its answer has %d bytes, may have %d' % (len(outcome.data), MAX_SIZE))
        return self._answer(self._of(execution.peer, execution.request.client), execution.request, outcome, now)

    def _of(self, peer: str, client: int) -> _Seen:
        """The memory of a session of an operator.

        Where there are too many, that of the longest silent one is reduced to its newest number.
        """
        key = peer, client
        if key not in self._seen:
            self._seen[key] = _Seen(self._former.pop(key, 0))
        self._seen.move_to_end(key)
        if len(self._seen) > MAX_OPERATORS:
            former = _superfluous(self._seen)
            self._former[former] = self._seen.pop(former).newest
        if len(self._former) > MAX_FORMER:
            del self._former[_superfluous(self._former)]
        return self._seen[key]

    def _repeated(self, peer: str, request: Request, seen: _Seen, now: float) -> Optional[bytes]:
        self.dropped['repeated'] += 1
        if self._in_progress(peer, request) or seen.crossing(request.number, now):
            return None
        answer = seen.answer(request.number, now)
        if answer is not None:
            return answer
        return answer_to(request, self.session, now, Outcome(
            failure='it came too late to the robot, which no longer knows whether the service was called')).pack()

    def _in_progress(self, peer: str, request: Request) -> bool:
        key = peer, request.client, request.number
        return key in self._running or any(key == _key(execution) for execution in self._waiting)

    def _refusal(self, request: Request) -> Optional[str]:
        """Why a new call is not executed; None: it is."""
        if request.checksum != self._checksum:
            self.dropped['type'] += 1
            return 'the service is of another type on the robot: %s as it is installed there' % self._type_name
        if len(self._running) + len(self._waiting) >= MAX_CALLS:
            self.dropped['busy'] += 1
            return '%d calls of it are still running on the robot' % (len(self._running) + len(self._waiting))
        return None

    def _answer(self, seen: _Seen, request: Request, outcome: Outcome, now: float) -> bytes:
        answer = answer_to(request, self.session, now, outcome).pack()
        seen.keep(request.number, answer, now)
        return answer


def _superfluous(sessions: Mapping[Tuple[str, int], Any]) -> Tuple[str, int]:
    """The oldest session of the node that has most of them: none can drive out those of the others."""
    most = collections.Counter(peer for peer, _ in sessions).most_common(1)[0][0]
    return next(key for key in sessions if key[0] == most)


def _key(execution: Execution) -> Tuple[str, int, int]:
    return execution.peer, execution.request.client, execution.request.number
