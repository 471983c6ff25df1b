# SPDX-License-Identifier: BSD-3-Clause
"""Both sides of a service over a link that loses, repeats, delays and reorders, while the robot's node restarts."""
import heapq
import itertools
import random
from typing import Any, Callable, Dict, List, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.reliable.call_client import CallClient
from smokebot_udp.reliable.call_server import CallServer
from smokebot_udp.reliable.calls import Outcome

CHECKSUM, TIMEOUT, CALLS = 31, 10.0, 60
AHEAD = 1000.0      # the robot's clock


class Link:
    """A client and the robot's nodes one after the other, in simulated time."""

    def __init__(self, seed: int, loss: float, repeats: float, restarts: int) -> None:
        self._random, self._loss, self._repeats = random.Random(seed), loss, repeats
        self._events: List[Tuple[float, int, Callable[..., None], Tuple[Any, ...]]] = []
        self._order = itertools.count()
        self._now = 0.0
        self.client = CallClient(1, CHECKSUM, TIMEOUT)
        self.server = CallServer(100, CHECKSUM, 'std_srvs/Trigger')
        self.executed: Dict[bytes, int] = {}
        self.outcomes: Dict[bytes, Outcome] = {}
        for number in range(CALLS):
            self._at(self._random.uniform(0.0, 30.0), self._call, b'%d' % number)
        for number in range(restarts):
            self._at(self._random.uniform(0.0, 30.0), self._restart, 101 + number)

    def run(self) -> None:
        while True:
            due = self.client.deadline()
            if self._events and (due is None or self._events[0][0] <= due):
                self._now, _, what, arguments = heapq.heappop(self._events)
                what(*arguments)
            elif due is not None:
                self._now = max(self._now, due)
            else:
                return
            self._send()

    def _at(self, when: float, what: Callable[..., None], *arguments: Any) -> None:
        heapq.heappush(self._events, (when, next(self._order), what, arguments))

    def _carry(self, what: Callable[..., None], *arguments: Any) -> None:
        """Deliver a message never, once or twice, some after seconds."""
        for chance in (1.0 - self._loss, self._repeats):
            if self._random.random() < chance:
                late = self._random.choice([0.05, 0.05, 0.05, 3.0])
                self._at(self._now + self._random.uniform(0.05, 0.05 + late), what, *arguments)

    def _send(self) -> None:
        while True:
            data = self.client.poll(self._now)
            if data is None:
                return
            self._carry(self._requested, data)

    def _answer(self, answer: bytes) -> None:
        self._carry(lambda: self.client.receive(answer, self._now))

    def _robot_time(self) -> float:
        return AHEAD + self._now

    def _call(self, data: bytes) -> None:
        def done(outcome: Outcome) -> None:
            assert data not in self.outcomes
            self.outcomes[data] = outcome
        self.client.call(data, self._now, done)

    def _requested(self, data: bytes) -> None:
        answer = self.server.receive('/desk', data, self._robot_time())
        if answer is not None:
            self._answer(answer)
        self._execute()

    def _execute(self) -> None:
        while True:
            execution = self.server.take(self._robot_time())
            if execution is None:
                return
            data = execution.request.data
            assert data not in self.outcomes        # nobody has given up
            self.executed[data] = self.executed.get(data, 0) + 1
            self._at(self._now + self._random.expovariate(5.0), self._finish, self.server, execution)

    def _finish(self, server: CallServer, execution: Any) -> None:
        if server is self.server:       # its process lives
            self._answer(server.finish(execution, Outcome(b'did ' + execution.request.data), self._robot_time()))
            self._execute()

    def _restart(self, session: int) -> None:
        self.server = CallServer(session, CHECKSUM, 'std_srvs/Trigger')


def run(*arguments: Any) -> Link:
    """A link that did all its calls: each was executed at most once and ended once, rightly."""
    link = Link(*arguments)
    link.run()
    assert len(link.outcomes) == CALLS
    assert set(link.executed.values()) <= {1}
    for data, outcome in link.outcomes.items():
        if outcome.failure is None:
            assert link.executed[data] == 1 and outcome.data == b'did ' + data
        elif 'was not called' in outcome.failure:
            assert data not in link.executed
    return link


@given(st.integers(0, 2 ** 32), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 5))
@settings(max_examples=150)
def test_each_call_is_executed_at_most_once_and_ends_once(seed, loss, repeats, restarts) -> None:
    run(seed, loss, repeats, restarts)


@pytest.mark.parametrize('seed', range(5))
def test_without_loss_every_call_is_answered(seed) -> None:
    link = run(seed, 0.0, 0.5, 0)
    assert all(outcome.failure is None for outcome in link.outcomes.values())


def test_most_calls_survive_half_the_messages() -> None:
    links = [run(seed, 0.5, 0.0, 0) for seed in range(10)]
    answered = sum(outcome.failure is None for link in links for outcome in link.outcomes.values())
    assert answered > 0.6 * 10 * CALLS


def test_after_a_restart_calls_are_answered_again() -> None:
    link = run(1, 0.0, 0.0, 1)
    failed = [outcome.failure for outcome in link.outcomes.values() if outcome.failure is not None]
    assert all('restarted' in failure for failure in failed) and len(failed) < CALLS / 2
