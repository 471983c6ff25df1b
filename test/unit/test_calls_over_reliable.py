# SPDX-License-Identifier: BSD-3-Clause
"""Calls over reliable channels over a bad link: all of it but threads and sockets, in simulated time."""
import itertools
import statistics
from typing import Dict, List

from reliable_sides import DOWN, UP, Link

from smokebot_udp.reliable.call_client import CallClient
from smokebot_udp.reliable.call_server import CallServer
from smokebot_udp.reliable.calls import Outcome

CHECKSUM, TIMEOUT, STEP = 31, 10.0, 0.001
CHANNELS = {channel: {'ordered': False, 'expedited': True} for channel in (UP, DOWN)}


class Calls:
    """An operator that has several calls in flight, and a robot that counts them."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.client = CallClient(1, CHECKSUM, TIMEOUT)
        self.executed: Dict[bytes, int] = {}
        self.outcomes: Dict[bytes, Outcome] = {}
        self.times: List[float] = []
        self._sessions, self._numbers = itertools.count(100), itertools.count()
        self._new_robot()

    def _new_robot(self) -> None:
        self._server = CallServer(next(self._sessions), CHECKSUM, 'std_srvs/Trigger')

    def restart_robot(self) -> None:
        self.link.restart('robot')
        self._new_robot()

    def run(self, seconds: float, at_once: int) -> None:
        """Begin a new call for each one that ends."""
        until = self.link.now + seconds
        while self.link.now < until:
            while len(self.client) < at_once:
                self._begin(b'%d' % next(self._numbers))
            self._exchange()

    def finish(self) -> None:
        while self.client:
            self._exchange()

    def _begin(self, data: bytes) -> None:
        begun = self.link.now

        def done(outcome: Outcome) -> None:
            assert data not in self.outcomes
            self.outcomes[data] = outcome
            self.times.append(self.link.now - begun)
        self.client.call(data, begun, done)

    def _exchange(self) -> None:
        while True:
            data = self.client.poll(self.link.now)
            if data is None:
                break
            self.link.send(UP, data)
        self.link.run(STEP)
        requests, self.link.robot.got[UP][:] = list(self.link.robot.got[UP]), []
        for request in requests:
            self._request(request)
        answers, self.link.desk.got[DOWN][:] = list(self.link.desk.got[DOWN]), []
        for answer in answers:
            self.client.receive(answer, self.link.now)

    def _request(self, request: bytes) -> None:
        answer = self._server.receive('/desk', request, self.link.now)
        if answer is not None:
            self.link.send(DOWN, answer)
        execution = self._server.take(self.link.now)
        if execution is not None:
            data = execution.request.data
            self.executed[data] = self.executed.get(data, 0) + 1
            self.link.send(DOWN, self._server.finish(execution, Outcome(data), self.link.now))

    def check(self) -> None:
        """Each was executed at most once, and those that were answered were executed."""
        assert set(self.executed.values()) == {1}
        assert all(data in self.executed for data, outcome in self.outcomes.items() if outcome.failure is None)
        assert all(outcome.data == data for data, outcome in self.outcomes.items() if outcome.failure is None)

    @property
    def failures(self) -> List[str]:
        return [outcome.failure for outcome in self.outcomes.values() if outcome.failure is not None]


def test_a_thousand_calls_at_half_the_datagrams_lost() -> None:
    calls = Calls(Link(6, loss=0.5, jitter=0.02, duplicates=0.1, channels=CHANNELS))
    calls.link.run(2.0)
    calls.run(40.0, 4)
    calls.finish()
    calls.check()
    assert len(calls.outcomes) > 1000 and calls.failures == []
    times = sorted(calls.times)
    print('%d calls: p99 %.0f ms' % (len(times), 1e3 * times[int(0.99 * len(times))]))
    assert statistics.median(times) < 0.15


def test_restarts_and_cuts() -> None:
    calls = Calls(Link(7, loss=0.3, jitter=0.02, duplicates=0.1, channels=CHANNELS))
    calls.link.run(2.0)
    for _ in range(4):
        calls.run(3.0, 4)
        calls.restart_robot()
        calls.run(3.0, 4)
        calls.link.loss = 1.0
        calls.run(4.0, 4)
        calls.link.loss = 0.3
    calls.finish()
    calls.check()
    assert calls.failures and all('restarted' in failure for failure in calls.failures)
    assert len(calls.failures) <= 4 * 4


def test_after_a_cut_nothing_is_executed_for_callers_who_have_given_up() -> None:
    calls = Calls(Link(8, channels=CHANNELS))
    calls.link.run(2.0)
    calls.run(1.0, 4)
    calls.link.loss = 1.0
    calls.run(TIMEOUT - 1.0, 4)
    calls.finish()
    executed = dict(calls.executed)
    calls.link.loss = 0.0
    calls.run(5.0, 0)
    assert calls.executed == executed and len(calls.failures) == 4
