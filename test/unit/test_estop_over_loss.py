# SPDX-License-Identifier: BSD-3-Clause
"""The emergency stop over a link that loses, repeats, reorders and holds up."""
from typing import Dict, List, Set, Tuple

import pytest
from control_world import World
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from smokebot_udp.teleop.records import Wish
from smokebot_udp.teleop.requests import MAX_AGE, MAX_AHEAD


@pytest.mark.parametrize('seed', [1, 2])
def test_it_is_in_force_within_250_ms_at_half_loss(seed: int) -> None:
    link = World(seed, delay=0.05, jitter=0.005, loss=0.5, duplicates=0.05)
    link.add('a')
    link.run(1.0)
    durations: List[float] = []
    for _ in range(1000):
        link.run(link.random.uniform(0.1, 0.3))
        began, request = link.now, link.ask('a', Wish.ENGAGE_ESTOP)
        assert link.run(5.0, lambda: link.server.estop.engaged)
        durations.append(link.now - began)
        assert link.run(5.0, lambda sent=request: link.outcome('a', sent) == '')    # type: ignore[misc]
        link.server.set_estop(False, 'the robot', link.robot_now)
    assert sum(duration <= 0.25 for duration in durations) >= 999
    assert sorted(durations)[500] < 0.07 and max(durations) < 0.4


@pytest.mark.parametrize('seed', range(5))
def test_a_release_at_half_loss_takes_effect_once_and_a_second_try_is_rarely_needed(seed: int) -> None:
    link = World(seed, loss=0.5, duplicates=0.3, held_up=0.1)
    link.add('a')
    link.run(2.0)
    tries = 0
    for _ in range(20):
        stop = link.ask('a', Wish.ENGAGE_ESTOP)
        assert link.run(5.0, lambda sent=stop: link.outcome('a', sent) == '')    # type: ignore[misc]
        while link.server.estop.engaged:
            link.run(0.3)
            release = link.ask('a', Wish.RELEASE_ESTOP)
            link.run(5.0, lambda sent=release: link.outcome('a', sent) is not None)     # type: ignore[misc]
            tries += 1
        link.run(1.0)
        assert not link.server.estop.engaged
    assert tries <= 22


class AnyLink(RuleBasedStateMachine):
    """Three persons at operators' nodes and one at the robot engage and release the stop; nodes are restarted, links
    cut. Each release of the latch is due to a release that a person has asked shortly before, and to no other one."""

    names = st.sampled_from(['a', 'b', 'c'])

    @initialize(seed=st.integers(0, 1 << 30), loss=st.sampled_from([0.0, 0.2, 0.5, 0.8]))
    def begin(self, seed: int, loss: float) -> None:
        self.link = World(seed, loss=loss, duplicates=0.3, held_up=0.2)
        for name in ('a', 'b', 'c'):
            self.link.add(name)
        self.link.after = self.observe
        self.engaged, self.robot = False, self.link.server.session
        self.asked: Dict[Tuple[str, int], float] = {}
        """{(operator, robot's session): when it asked for a release}, of those that have not taken effect."""
        self.stops: Dict[str, float] = {}
        """{operator: when it engaged the stop}, of its present node."""
        self.ended = -1.0
        """When the stop was released on purpose last."""
        self.driving: Set[str] = set()

    def observe(self) -> None:
        """Note what has become of the latch."""
        server = self.link.server
        if server.session != self.robot:
            self.robot, self.engaged = server.session, False
        if self.engaged and not server.estop.engaged:
            due = [key for key, when in self.asked.items()
                   if key[1] == self.robot and self.link.now - when <= MAX_AGE + MAX_AHEAD + self.link.delay]
            assert due, 'released by nobody'
            self.ended = self.link.now
            if len(due) == 1:
                del self.asked[due[0]]
        self.engaged = server.estop.engaged

    @rule(duration=st.sampled_from([0.01, 0.1, 0.5, 3.0]))
    def wait(self, duration: float) -> None:
        self.link.run(duration)

    @rule(name=names)
    def engage(self, name: str) -> None:
        self.link.ask(name, Wish.ENGAGE_ESTOP)
        self.stops[name] = self.link.now

    @rule(name=names)
    def release(self, name: str) -> None:
        try:
            self.link.ask(name, Wish.RELEASE_ESTOP)
        except ValueError:
            return
        self.asked[name, self.link.desks[name].client.robot] = self.link.now

    @rule(name=names, wish=st.sampled_from([Wish.TAKE_CONTROL, Wish.RELEASE_CONTROL]))
    def drive(self, name: str, wish: Wish) -> None:
        try:
            self.link.ask(name, wish)
        except ValueError:
            return

    @rule(engaged=st.booleans())
    def at_the_robot(self, engaged: bool) -> None:
        self.link.server.set_estop(engaged, 'the robot', self.link.robot_now)
        if not engaged:
            self.ended = self.link.now
        self.engaged = engaged

    @rule(name=names)
    def cut(self, name: str) -> None:
        self.link.cut[name] = not self.link.cut[name]

    @rule(name=names)
    def restart_operator(self, name: str) -> None:
        self.link.add(name)
        self.stops.pop(name, None)

    @rule()
    def restart_robot(self) -> None:
        self.link.restart_robot()
        self.observe()

    def teardown(self) -> None:
        """In the end the link is good, all know the same, and the stop of whoever engaged it is in force."""
        if not hasattr(self, 'link'):
            return
        link = self.link
        link.loss = link.duplicates = link.held_up = 0.0
        link.cut = {name: False for name in link.cut}
        link.run(8.0)       # the last datagrams that were held up come, and the lease of what they pretend ends
        engaged, driver = link.server.estop.engaged, link.server.control.driver
        for desk in link.desks.values():
            status = desk.client.status
            assert status is not None and status.session == link.server.session
            assert desk.client.estop == status.estop == engaged
            assert status.driver == (driver.name if driver else '')
        for name, when in self.stops.items():
            assert engaged or self.ended >= when, 'the stop of %s was lost' % name


AnyLink.TestCase.settings = settings(max_examples=80, stateful_step_count=30)
TestAnyLink = AnyLink.TestCase
