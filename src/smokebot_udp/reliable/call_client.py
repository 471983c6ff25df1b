# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of a service of the robot: its calls in flight. See calls.py."""
import collections
import math
from dataclasses import dataclass
from typing import Callable, Counter, Deque, Dict, Optional

from .calls import MAX_CALLS, MAX_SIZE, WELCOME, Outcome, Request, unpack_answer
from .clock_bound import ClockBound

GREETING_PERIOD = 0.25
"""While calls wait for a robot it is asked for its session this often [s]."""

MAX_BYTES = 4 << 20
"""Of all requests in flight."""

MAX_RETIRED = 16
"""Sessions of the robot's node that are remembered to be over."""

Done = Callable[[Outcome], None]
"""Called once for each call, from any of the client's methods."""


@dataclass
class _Call:
    data: bytes
    until: float
    done: Done
    server: int = 0
    """Session of the robot's node that may have executed it; 0: it was not sent yet."""


class CallClient:
    """Calls of one service. The clock is an argument [s, any steady clock].

    :param session: of this node, not 0
    :param checksum: see calls.type_checksum
    :param timeout: of each call [s]
    """

    def __init__(self, session: int, checksum: int, timeout: float) -> None:
        self.session, self.timeout = session, timeout
        self.dropped: Counter[str] = collections.Counter()
        """{reason: answers that were discarded}"""
        self._checksum = checksum
        self._calls: Dict[int, _Call] = {}      # by number, oldest first
        self._last = 0
        self._server = 0        # the robot's session; 0: unknown
        self._clock = ClockBound()      # of the robot
        self._retired: Deque[int] = collections.deque(maxlen=MAX_RETIRED)
        self._greeting = math.inf       # when it is due
        self._greeted = 0               # its number, until it is answered; 0: there is none

    def __len__(self) -> int:
        """The number of calls in flight."""
        return len(self._calls)

    def call(self, data: bytes, now: float, done: Done) -> None:
        """Begin a call.

        :param data: the serialised request
        """
        refusal = self._refusal(len(data))
        if refusal is not None:
            done(Outcome(failure=refusal))
            return
        self._last += 1
        self._calls[self._last] = _Call(data, now + self.timeout, done)
        if not self._server:
            self._greeting = min(self._greeting, now)

    def _refusal(self, size: int) -> Optional[str]:
        """Why a request of this size is not sent; None: it is."""
        if size > MAX_SIZE:
            return 'its request has %d bytes, may have %d' % (size, MAX_SIZE)
        if len(self._calls) >= MAX_CALLS or size + sum(len(call.data) for call in self._calls.values()) > MAX_BYTES:
            return '%d calls of it wait for an answer already' % len(self._calls)
        return None

    def greet(self, now: float) -> None:
        """Ask the robot for its session: it may be another node now."""
        self._greeting = now

    def poll(self, now: float) -> Optional[bytes]:
        """The next message to the robot; None: there is none until `deadline`. Calls whose time is over fail."""
        self._expire(now)
        if self._greeting <= now:
            self._greeting = now + GREETING_PERIOD if self._calls and not self._server else math.inf
            if not self._greeted:
                self._last += 1
                self._greeted = self._last
            return Request(self.session, 0, self._greeted, self._checksum, 0.0, b'').pack()
        if not self._server:
            return None
        for number, call in self._calls.items():
            if not call.server:
                call.server = self._server
                until = self._clock.at(call.until)
                return Request(self.session, self._server, number, self._checksum, until, call.data).pack()
        return None

    def deadline(self) -> Optional[float]:
        """When `poll` has something to do; None: not before the next call or answer."""
        times = [self._greeting]
        for call in self._calls.values():
            times += [call.until, -math.inf if self._server and not call.server else math.inf]
        first = min(times)
        return None if first == math.inf else first

    def receive(self, data: bytes, now: float) -> None:
        """Take a message of the robot."""
        answer = unpack_answer(data)
        if answer is None:
            self.dropped['malformed'] += 1
        elif answer.client != self.session or answer.server in self._retired:
            self.dropped['another session'] += 1
        elif answer.kind == WELCOME:
            if answer.server != self._server and not self._answers_the_present(answer.number):
                self.dropped['late'] += 1
                return
            self._welcome(answer.server)
            self._clock.add(answer.clock, now)
        elif answer.number not in self._calls or self._calls[answer.number].server != answer.server:
            self.dropped['late'] += 1
        else:
            self._clock.add(answer.clock, now)
            self._calls.pop(answer.number).done(answer.outcome)

    def fail(self, reason: str) -> None:
        """All calls in flight fail."""
        self._end(lambda call: True, reason)

    def lost(self, reason: str) -> None:
        """The session of a channel is over, and what was in flight in it: the calls fail that were sent. Others wait
        for the robot's session."""
        self._fail_sent(reason)
        self._server, self._greeting = 0, -math.inf if self._calls else math.inf

    def refuse(self, reason: str) -> None:
        """The robot does not take calls: those fail that were not sent to it."""
        self._end(lambda call: not call.server, reason + ': it was not called')

    def _answers_the_present(self, number: int) -> bool:
        """Whether an answer is to something that was sent after the present robot's node was known: then the node that
        gave it is no former one, whose answer was held up."""
        call = self._calls.get(number)
        return not self._server or 0 < number == self._greeted or (call is not None and call.server == self._server)

    def _welcome(self, server: int) -> None:
        """The robot's node has this session: another one has lost the calls that it did not answer."""
        self._greeting, self._greeted = math.inf, 0
        if server == self._server:
            return
        if self._server:
            self._retired.append(self._server)
        self._server, self._clock = server, ClockBound()
        self._fail_sent("the robot's node restarted during the call")

    def _fail_sent(self, reason: str) -> None:
        self._end(lambda call: call.server != 0, reason + ': whether the service was called is unknown')

    def _expire(self, now: float) -> None:
        self._end(lambda call: call.until <= now and not call.server,
                  'no robot answered within %g s: the service was not called' % self.timeout)
        self._end(lambda call: call.until <= now,
                  'no answer within %g s: whether the service was called is unknown' % self.timeout)

    def _end(self, ends: Callable[[_Call], bool], reason: str) -> None:
        for number in [number for number, call in self._calls.items() if ends(call)]:
            self._calls.pop(number).done(Outcome(failure=reason))
