# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of a service: executes the calls of all operators. See calls.py."""
import collections
from typing import Counter, Deque, List, NamedTuple, Optional

from .calls import GREETING, MAX_CALLS, MAX_SIZE, MAX_TIMEOUT, Answer, Outcome, Request, unpack_request

MAX_RUNNING = 8
"""Calls of one service that are executed at the same time; further ones wait."""


class Execution(NamedTuple):
    """A call that is to be executed now."""
    peer: str
    """The operator's node."""
    request: Request
    until: float
    """Nobody waits for the answer afterwards [s]."""


class CallServer:
    """Calls of one service by all operators. The clock is an argument [s, any steady clock].

    :param checksum: see calls.type_checksum
    :param type_name: of the service
    """

    def __init__(self, checksum: int, type_name: str) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """{reason: requests that were not executed}"""
        self._checksum, self._type_name = checksum, type_name
        self._waiting: Deque[Execution] = collections.deque()
        self._running: List[Execution] = []

    @property
    def running(self) -> int:
        """The number of calls that are executed now."""
        return len(self._running)

    def overdue(self, now: float) -> int:
        """The number of calls that are executed although nobody waits for the answer any more."""
        return sum(execution.until <= now for execution in self._running)

    def receive(self, peer: str, data: bytes, now: float) -> Optional[bytes]:
        """Take a message of an operator; the answer to it, where it has one at once.

        :param peer: the operator's node
        """
        request = unpack_request(data)
        if request is None:
            self.dropped['malformed'] += 1
            return None
        if request.number == GREETING:
            return Answer(GREETING, now, Outcome()).pack()
        refusal = self._refusal(request)
        if refusal is not None:
            return Answer(request.number, now, Outcome(failure=refusal)).pack()
        self._waiting.append(Execution(peer, request, min(request.until, now + MAX_TIMEOUT)))
        return None

    def take(self, now: float) -> Optional[Execution]:
        """The next call to execute; None: none waits, or MAX_RUNNING are executed."""
        while self._waiting and len(self._running) < MAX_RUNNING:
            execution = self._waiting.popleft()
            if execution.until > now:
                self._running.append(execution)
                return execution
            self.dropped['too late'] += 1
        return None

    def finish(self, execution: Execution, outcome: Outcome, now: float) -> bytes:
        """A call that `take` gave was executed; the answer to its operator."""
        self._running.remove(execution)
        if len(outcome.data) > MAX_SIZE:
            outcome = Outcome(failure='its answer has %d bytes, may have %d' % (len(outcome.data), MAX_SIZE))
        return Answer(execution.request.number, now, outcome).pack()

    def _refusal(self, request: Request) -> Optional[str]:
        """Why a new call is not executed; None: it is."""
        if request.checksum != self._checksum:
            self.dropped['type'] += 1
            return 'the service is of another type on the robot: %s as it is installed there' % self._type_name
        if len(self._running) + len(self._waiting) >= MAX_CALLS:
            self.dropped['busy'] += 1
            return '%d calls of it are still running on the robot' % (len(self._running) + len(self._waiting))
        return None
