# SPDX-License-Identifier: BSD-3-Clause
"""Who drives: tables worked by hand, and what holds after any sequence of events."""
from typing import Dict, List, Optional, Tuple

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from smokebot_udp.teleop.control import FORMER_SESSION, NOT_PRESENT, TOO_MANY, Control
from smokebot_udp.teleop.records import MAX_OPERATORS
from smokebot_udp.teleop.sessions import LEASE, MAX_FORMER, LivingSession

Step = Tuple[str, str, float, Optional[str], str]


def driver(control: Control) -> str:
    return control.driver.name if control.driver else ''


TABLES: Dict[str, List[Step]] = {   # what happens, to whom, when [s]; its refusal, and who drives then
    'a sole operator drives without asking': [
        ('heard', 'a', 0.0, None, 'a'), ('heard', 'a', 1.5, None, 'a'), ('poll', '', 3.4, None, 'a'),
        ('poll', '', 3.5, None, '')],
    'with several, the one who has control keeps it': [
        ('heard', 'a', 0.0, None, 'a'), ('heard', 'b', 0.1, None, 'a'), ('heard', 'c', 0.2, None, 'a')],
    'who takes control has it at once': [
        ('heard', 'a', 0.0, None, 'a'), ('heard', 'b', 0.1, None, 'a'), ('take', 'b', 0.2, None, 'b'),
        ('heard', 'a', 0.3, None, 'b'), ('take', 'a', 0.4, None, 'a'), ('take', 'a', 0.5, None, 'a')],
    'after a release nobody drives until somebody takes control': [
        ('heard', 'a', 0.0, None, 'a'), ('heard', 'b', 0.1, None, 'a'), ('release', 'a', 0.2, None, ''),
        ('heard', 'b', 0.3, None, ''), ('heard', 'a', 0.4, None, ''), ('take', 'b', 0.5, None, 'b')],
    'only who holds control releases it': [
        ('heard', 'a', 0.0, None, 'a'), ('heard', 'b', 0.1, None, 'a'), ('release', 'b', 0.2, 'a drives', 'a'),
        ('release', 'a', 0.3, None, ''), ('release', 'a', 0.4, 'nobody drives', '')],
    'a sole operator who released control has to take it': [
        ('heard', 'a', 0.0, None, 'a'), ('release', 'a', 0.1, None, ''), ('heard', 'a', 0.2, None, ''),
        ('take', 'a', 0.3, None, 'a')],
    'who is left alone drives, unless it has released control': [
        ('heard', 'a', 0.0, None, 'a'), ('heard', 'b', 0.0, None, 'a'), ('left', 'a', 0.1, None, 'b'),
        ('release', 'b', 0.2, None, ''), ('heard', 'a', 0.3, None, ''), ('left', 'b', 0.4, None, 'a')],
    'a holder whose link is cut for 3 s is a newcomer': [
        ('heard', 'a', 0.0, None, 'a'), ('heard', 'b', 0.1, None, 'a'), ('heard', 'b', 1.9, None, 'a'),
        ('heard', 'b', 2.1, None, 'b'), ('heard', 'a', 3.0, None, 'b'), ('take', 'a', 3.1, None, 'a')],
    'a sole holder whose link is cut for 3 s drives again': [
        ('heard', 'a', 0.0, None, 'a'), ('poll', '', 2.0, None, ''), ('heard', 'a', 3.0, None, 'a')],
    'with two others nobody drives after the holder is gone': [
        ('heard', 'a', 0.0, None, 'a'), ('heard', 'b', 0.1, None, 'a'), ('heard', 'c', 0.1, None, 'a'),
        ('left', 'a', 0.2, None, ''), ('heard', 'b', 0.3, None, ''), ('take', 'c', 0.4, None, 'c')],
    'a stranger can neither take nor release control': [
        ('take', 'x', 0.0, NOT_PRESENT, ''), ('heard', 'a', 0.0, None, 'a'), ('take', 'x', 0.1, NOT_PRESENT, 'a'),
        ('release', 'x', 0.2, NOT_PRESENT, 'a')],
    'what has no session renews a lease, but makes nobody an operator': [
        ('renew', 'a', 0.0, None, ''), ('heard', 'a', 0.0, None, 'a'), ('renew', 'a', 1.9, None, 'a'),
        ('poll', '', 3.8, None, 'a'), ('renew', 'a', 3.9, None, '')],
}


@pytest.mark.parametrize('name', TABLES)
def test_table(name: str) -> None:
    control = Control()
    for number, (what, who, now, refusal, drives) in enumerate(TABLES[name]):
        result = None
        if what == 'poll':
            control.poll(now)
        elif what == 'heard':
            result = control.heard(who, ord(who), now)
        elif what == 'renew':
            control.renew(who, now)
        else:
            result = getattr(control, what)(who)
        assert (result, driver(control)) == (refusal, drives), 'step %d' % number


def test_a_restarted_node_keeps_its_place_and_its_late_datagrams_have_no_effect() -> None:
    control = Control()
    assert control.heard('a', 1, 0.0) is control.heard('b', 2, 0.0) is None
    assert control.heard('a', 3, 0.5) is None and control.driver is not None and control.driver.session == 3
    assert control.heard('a', 1, 0.6) == FORMER_SESSION and control.driver.session == 3
    assert control.deadline() == LEASE     # of b: what is late renews no lease of a, either
    control.poll(LEASE)
    control.poll(0.5 + LEASE)
    assert control.driver is None and control.operators == []


def test_a_restart_takes_back_a_release() -> None:
    control = Control()
    control.heard('a', 1, 0.0)
    control.release('a')
    control.heard('a', 1, 0.1)
    assert control.driver is None
    control.heard('a', 2, 0.2)
    assert driver(control) == 'a'


def test_no_more_than_eight_operators() -> None:
    control = Control()
    names = ['operator %d' % number for number in range(MAX_OPERATORS)]
    assert [control.heard(name, 1 + number, 0.0) for number, name in enumerate(names)] == [None] * 8
    assert control.heard('stranger', 99, 0.1) == TOO_MANY
    assert control.take('stranger') == NOT_PRESENT and driver(control) == names[0]
    control.left(names[3])
    assert control.heard('stranger', 99, 0.2) is None


def test_forged_sessions_cost_no_memory_and_the_true_one_returns_when_they_end() -> None:
    living = LivingSession()
    assert living.take(1, 0.0)
    for forged in range(10_000):
        assert living.take(2 + forged, 1.0)
    assert living.current == 10_001
    assert not living.take(10_001 - MAX_FORMER, 1.1) and living.take(10_000 - MAX_FORMER, 1.1)
    assert not living.take(10_001, 1.2)
    assert not living.take(10_001, 1.1 + LEASE) and living.take(10_001, 1.2 + LEASE)


class AnyOrder(RuleBasedStateMachine):
    """Operators come, go, take and release control at any time; a list of who was heard when is the reference."""

    def __init__(self) -> None:
        super().__init__()
        self.control, self.now = Control(), 0.0
        self.heard: Dict[str, float] = {}
        self.sessions: Dict[str, int] = {}
        self.released: Dict[str, bool] = {}
        self.drove = ''

    names = st.sampled_from(['operator %d' % number for number in range(10)] + 6 * ['operator 0', 'operator 1'])

    def gone(self) -> None:
        """Forget who was not heard."""
        self.heard = {name: when for name, when in self.heard.items() if self.now - when < LEASE}

    @rule(name=names, restarted=st.sampled_from([False, False, False, True]))
    def hear(self, name: str, restarted: bool) -> None:
        self.gone()
        new = name not in self.heard
        full = new and len(self.heard) == MAX_OPERATORS
        self.sessions[name] = self.sessions.get(name, 0) + restarted if name in self.sessions else 1
        assert self.control.heard(name, self.sessions[name], self.now) == (TOO_MANY if full else None)
        if not full:
            self.heard[name] = self.now
            self.released[name] = self.released.get(name, False) and not new and not restarted
        if self.drove in self.heard:
            assert driver(self.control) == self.drove

    @rule(name=names)
    def leave(self, name: str) -> None:
        self.control.left(name)
        self.heard.pop(name, None)

    @rule(name=names)
    def take(self, name: str) -> None:
        self.control.poll(self.now)
        self.gone()
        assert self.control.take(name) == (None if name in self.heard else NOT_PRESENT)
        if name in self.heard:
            self.released[name] = False
            assert driver(self.control) == name

    @rule(name=names)
    def release(self, name: str) -> None:
        self.control.poll(self.now)
        self.gone()
        before = driver(self.control)
        assert (self.control.release(name) is None) == (before == name)
        assert driver(self.control) == ('' if before == name else before)
        if before == name:
            self.released[name] = True

    @precondition(lambda self: self.heard)
    @rule(duration=st.sampled_from([0.3, 1.0, LEASE]))
    def wait(self, duration: float) -> None:
        self.now += duration
        self.control.poll(self.now)
        self.gone()
        if self.drove in self.heard:
            assert driver(self.control) == self.drove

    @invariant()
    def only_who_is_present_drives(self) -> None:
        self.control.poll(self.now)
        self.gone()
        present = {operator.name: operator.session for operator in self.control.operators}
        assert present == {name: self.sessions[name] for name in self.heard}
        self.drove = driver(self.control)
        assert not self.drove or self.drove in self.heard
        if len(self.heard) == 1 and not self.released[next(iter(self.heard))]:
            assert self.drove
        deadline = self.control.deadline()
        assert deadline == (min(self.heard.values()) + LEASE if self.heard else None)


AnyOrder.TestCase.settings = settings(max_examples=60, stateful_step_count=40)
TestAnyOrder = AnyOrder.TestCase
