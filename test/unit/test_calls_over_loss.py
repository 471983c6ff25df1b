# SPDX-License-Identifier: BSD-3-Clause
"""Calls over reliable channels over a bad link, while the robot's node restarts: all of it but threads and sockets, in
simulated time.
"""
import itertools
import statistics
from typing import Any, Dict, List, Tuple

from hypothesis import given, settings
from hypothesis import strategies as st
from reliable_sides import DOWN, UP, Link

from smokebot_udp.reliable.bounds import Bounds
from smokebot_udp.reliable.call_client import CallClient
from smokebot_udp.reliable.call_server import CallServer
from smokebot_udp.reliable.calls import Outcome

CHECKSUM, TIMEOUT, STEP = 31, 10.0, 0.001
CHANNELS = {channel: {'ordered': False, 'expedited': True, 'bounds': Bounds(one_session=True)}
            for channel in (UP, DOWN)}


class Calls:
    """An operator that has several calls in flight, and a robot that counts them.

    :param mean: time that a call takes on the robot [s]
    """

    def __init__(self, link: Link, mean: float = 0.0, step: float = STEP) -> None:
        self.link, self._mean, self._step = link, mean, step
        self.client = CallClient(1, CHECKSUM, TIMEOUT)
        self.executed: Dict[bytes, int] = {}
        self.outcomes: Dict[bytes, Outcome] = {}
        self.times: List[float] = []
        self._numbers = itertools.count()
        self._new_robot()

    def _new_robot(self) -> None:
        self._server = CallServer(CHECKSUM, 'std_srvs/Trigger')
        self._ends: List[Tuple[float, Any]] = []      # of calls that are executed

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
            message = self.client.poll(self.link.now)
            if message is None:
                break
            self.link.send(UP, message.data)
        self.link.run(self._step)
        desk = self.link.desk
        told, desk.told[:] = list(desk.told), []
        for event in told:      # as nodes/operator_service.py does
            if event == 'joined':
                self.client.joined('robot')
            else:
                self.client.left('robot', 'the session of the channel has ended')
        self._execute()
        answers, desk.got[DOWN][:] = list(desk.got[DOWN]), []
        for answer in answers:
            self.client.receive('robot', answer, self.link.now)

    def _execute(self) -> None:
        now = self.link.now
        requests, self.link.robot.got[UP][:] = list(self.link.robot.got[UP]), []
        for request in requests:
            answer = self._server.receive('/desk', request, now)
            if answer is not None:
                self.link.send(DOWN, answer)
        while True:
            execution = self._server.take(now)
            if execution is None:
                break
            data = execution.request.data
            assert data not in self.outcomes        # nobody has given up
            self.executed[data] = self.executed.get(data, 0) + 1
            takes = self.link.random.expovariate(1 / self._mean) if self._mean else 0.0
            self._ends.append((now + takes, execution))
        for end in [end for end in self._ends if end[0] <= now]:
            self._ends.remove(end)
            self.link.send(DOWN, self._server.finish(end[1], Outcome(end[1].request.data), now))

    def check(self) -> None:
        """Each was executed at most once, those that were answered were executed, and no failure says what is untrue.
        """
        assert set(self.executed.values()) <= {1}
        for data, outcome in self.outcomes.items():
            if outcome.failure is None:
                assert self.executed[data] == 1 and outcome.data == data
            elif 'was not called' in outcome.failure:
                assert data not in self.executed

    @property
    def failures(self) -> List[str]:
        return [outcome.failure for outcome in self.outcomes.values() if outcome.failure is not None]


@given(st.integers(0, 2 ** 32), st.floats(0.0, 0.95), st.floats(0.0, 1.0), st.floats(0.0, 3.0),
       st.lists(st.tuples(st.floats(0.1, 5.0), st.sampled_from(['restart', 'cut', 'whole'])), max_size=6))
@settings(max_examples=25, deadline=None)
def test_each_call_is_executed_at_most_once_and_ends_once(
        seed: int, loss: float, duplicates: float, jitter: float, happens: List[Tuple[float, str]]) -> None:
    calls = Calls(Link(seed, loss=loss, jitter=jitter, duplicates=duplicates, channels=CHANNELS), 0.2, 0.02)
    for seconds, what in happens:
        calls.run(seconds, 8)
        if what == 'restart':
            calls.restart_robot()
        else:
            calls.link.loss = loss if what == 'whole' else 1.0
    calls.run(1.0, 8)
    calls.finish()
    calls.check()


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
    assert calls.failures and all('is unknown' in failure for failure in calls.failures)
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
