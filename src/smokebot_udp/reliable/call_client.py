# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of a service of the robot: its calls in flight. See calls.py."""
import collections
import math
from dataclasses import dataclass
from typing import Callable, Counter, Dict, NamedTuple, Optional

from .calls import GREETING, MAX_CALLS, MAX_SIZE, Outcome, Request, unpack_answer

CLOCK_WINDOW = 60.0
"""Clocks drift apart: what is older than two windows is forgotten once there is something newer [s]."""

MAX_BYTES = 4 << 20
"""Size of all requests in flight together, at most [byte]."""

Done = Callable[[Outcome], None]
"""Called once for each call, from any of the client's methods."""


class ClockBound:
    """A lower bound of another node's steady clock; it is low by the time that the fastest message took."""

    def __init__(self) -> None:
        self._begun = -math.inf     # of the window
        self._offset = self._before = -math.inf     # in this window, in the one before

    def add(self, sent: float, now: float) -> None:
        """A message came.

        :param sent: when, by the other clock [s]
        """
        if now - self._begun > CLOCK_WINDOW:
            self._begun, self._before, self._offset = now, self._offset, -math.inf
        self._offset = max(self._offset, sent - now)

    def at(self, now: float) -> float:
        """The least that the other clock shows at a time of this one [s]; -infinity: unknown."""
        return now + max(self._offset, self._before)


class Message(NamedTuple):
    """What is to be sent."""
    robot: str
    """The robot's node."""
    data: bytes


@dataclass
class _Call:
    data: bytes
    until: float
    done: Done
    robot: str = ''
    """The robot's node that it was sent to; empty: it was not sent yet."""


class CallClient:
    """Calls of one service. The clock is an argument [s, any steady clock].

    :param first: the first call's number: a random one of 64 bits, other than GREETING
    :param checksum: see calls.type_checksum
    :param timeout: of each call [s]
    """

    def __init__(self, first: int, checksum: int, timeout: float) -> None:
        self.timeout = timeout
        self.dropped: Counter[str] = collections.Counter()
        """{reason: answers that were discarded}"""
        self._checksum = checksum
        self._calls: Dict[int, _Call] = {}      # by number, oldest first
        self._next = first
        self._peer = ''         # the robot's node with which the channels have a session; empty: none
        self._greets = False    # whether that node is to be greeted
        self._robot = ''        # the node that has answered the greeting
        self._clock = ClockBound()      # of it

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
        self._calls[self._next] = _Call(data, now + self.timeout, done)
        self._next += 1
        self._greets |= not self._robot

    def _refusal(self, size: int) -> Optional[str]:
        """Why a request of this size is not sent; None: it is."""
        if size > MAX_SIZE:
            return 'its request has %d bytes, may have %d' % (size, MAX_SIZE)
        if len(self._calls) >= MAX_CALLS or size + sum(len(call.data) for call in self._calls.values()) > MAX_BYTES:
            return '%d calls of it wait for an answer already' % len(self._calls)
        return None

    def joined(self, peer: str) -> None:
        """A session with a node of the robot has begun."""
        self._peer, self._greets = peer, True

    def left(self, peer: str, reason: str) -> None:
        """That session is over, and what was in flight in it: the calls fail that were sent. Others wait for the next
        one."""
        self._end(lambda call: call.robot == peer, reason + ': whether the service was called is unknown')
        if peer == self._robot:
            self._robot = ''

    def poll(self, now: float) -> Optional[Message]:
        """The next message; None: there is none until `deadline`. Calls whose time is over fail."""
        self._expire(now)
        if self._greets and self._peer:
            self._greets = False
            return Message(self._peer, Request(GREETING, self._checksum, 0.0, b'').pack())
        for number, call in self._calls.items():
            if self._robot and not call.robot:
                call.robot = self._robot
                request = Request(number, self._checksum, self._clock.at(call.until), call.data)
                return Message(call.robot, request.pack())
        return None

    def deadline(self) -> float:
        """When `poll` has something to do [s]; infinite: not before the next call or answer."""
        if (self._greets and self._peer) or (self._robot and not all(call.robot for call in self._calls.values())):
            return -math.inf
        return min((call.until for call in self._calls.values()), default=math.inf)

    def receive(self, peer: str, data: bytes, now: float) -> None:
        """Take a message of a node of the robot."""
        answer = unpack_answer(data)
        if answer is None:
            self.dropped['malformed'] += 1
        elif answer.number == GREETING:
            if peer != self._robot:
                self._robot, self._clock = peer, ClockBound()
            self._clock.add(answer.clock, now)
        elif answer.number not in self._calls or self._calls[answer.number].robot != peer:
            self.dropped['late'] += 1
        else:
            self._clock.add(answer.clock, now)
            self._calls.pop(answer.number).done(answer.outcome)

    def fail(self, reason: str) -> None:
        """All calls in flight fail."""
        self._end(lambda call: True, reason)

    def refuse(self, reason: str) -> None:
        """The robot does not take calls: those fail that were not sent to it."""
        self._end(lambda call: not call.robot, reason + ': it was not called')

    def _expire(self, now: float) -> None:
        self._end(lambda call: call.until <= now and not call.robot,
                  'no robot answered within %g s: the service was not called' % self.timeout)
        self._end(lambda call: call.until <= now,
                  'no answer within %g s: whether the service was called is unknown' % self.timeout)

    def _end(self, ends: Callable[[_Call], bool], reason: str) -> None:
        for number in [number for number, call in self._calls.items() if ends(call)]:
            self._calls.pop(number).done(Outcome(failure=reason))
