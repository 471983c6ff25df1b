# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.interlock import CLOCK_UNKNOWN, START_FROM_NEUTRAL, Interlock

OLD, NONE, DRIVES = 'thermal is 1.5 s old', 'no image of thermal', 'b drives'

PUSHED = 'linear.x'
NOT_NEUTRAL = START_FROM_NEUTRAL + ': linear.x is not at rest'

Step = Tuple[Optional[str], Optional[float], bool, str, Optional[str]]


@pytest.mark.parametrize('steps', [
    # what is not neutral, age of the view, clock known, refusal; why it is not sent
    [(None, None, True, '', NONE), (PUSHED, 0.1, True, '', NOT_NEUTRAL), (None, 0.1, True, '', None),
     (PUSHED, 0.1, True, '', None)],
    [(None, 0.1, True, '', None), (PUSHED, 1.0, True, '', None), (PUSHED, 1.5, True, '', OLD),
     (None, 1.5, True, '', OLD), (PUSHED, 0.1, True, '', NOT_NEUTRAL), (PUSHED, 0.1, True, '', NOT_NEUTRAL),
     (None, 0.1, True, '', None), (PUSHED, 0.1, True, '', None)],
    [(None, 0.1, True, '', None), (PUSHED, 0.1, False, '', CLOCK_UNKNOWN), (PUSHED, 0.1, True, DRIVES, DRIVES),
     (PUSHED, 0.1, True, '', NOT_NEUTRAL), (None, 0.1, True, '', None)],
    [(None, 1.5, False, DRIVES, OLD), (None, 0.1, False, DRIVES, CLOCK_UNKNOWN)],
    [(None, math.nan, True, '', 'thermal is nan s old'), (None, -5.0, True, '', 'thermal is -5.0 s old')],
])
def test_after_a_lock_only_a_neutral_command_opens(steps: List[Step]) -> None:
    interlock = Interlock('thermal', 1.0)
    for deviation, age, clock_known, refusal, reason in steps:
        assert interlock.may_send(deviation, age, clock_known, refusal) == reason


def test_a_lock_without_commands_counts() -> None:
    interlock = Interlock('thermal', 1.0)
    assert interlock.may_send(None, 0.1, True, '') is None and interlock.look(0.1, True, '') is None
    assert interlock.look(1.5, True, '') == OLD
    assert interlock.look(0.1, True, '') == START_FROM_NEUTRAL
    assert interlock.may_send(PUSHED, 0.1, True, '') == NOT_NEUTRAL == interlock.look(0.1, True, '')
    assert interlock.may_send(None, 0.1, True, '') is None and interlock.look(0.1, True, '') is None


def test_without_a_required_image_commands_are_only_kept_back() -> None:
    interlock = Interlock('', 1.0)
    for age in (None, 0.1, 1000.0):
        assert interlock.may_send(PUSHED, age, True, '') is None
        assert interlock.may_send(PUSHED, age, False, '') == CLOCK_UNKNOWN
        assert interlock.may_send(PUSHED, age, True, DRIVES) == DRIVES
    assert interlock.may_send(PUSHED, None, True, '') is None


def test_the_limit_may_change() -> None:
    interlock = Interlock('thermal', 1.0)
    assert interlock.may_send(None, 0.9, True, '') is None
    interlock.max_view_age = 0.5
    assert interlock.may_send(None, 0.9, True, '') == 'thermal is 0.9 s old'


@pytest.mark.parametrize('require_fresh', ['', 'thermal'])
def test_after_an_emergency_stop_the_first_command_is_neutral(require_fresh: str) -> None:
    interlock = Interlock(require_fresh, 1.0)
    assert interlock.may_send(None, 0.1, True, 'not heard yet') == 'not heard yet'
    assert interlock.may_send(None, 0.1, True, '', 4) is None and interlock.may_send(PUSHED, 0.1, True, '', 4) is None
    assert interlock.may_send(PUSHED, 0.1, True, 'emergency stop by b', 4) == 'emergency stop by b'
    assert interlock.may_send(None, 0.1, True, 'emergency stop by b', 4) == 'emergency stop by b'
    assert interlock.may_send(PUSHED, 0.1, True, '', 5) == NOT_NEUTRAL
    assert interlock.may_send(None, 0.1, True, '', 5) is None and interlock.may_send(PUSHED, 0.1, True, '', 5) is None
    # a stop and its release of which this operator has heard afterwards
    assert interlock.look(0.1, True, '', 6) == NOT_NEUTRAL and interlock.awaits_neutral
    assert interlock.may_send(PUSHED, 0.1, True, '', 6) == NOT_NEUTRAL
    assert interlock.may_send(None, 0.1, True, '', 6) is None and not interlock.awaits_neutral


def test_where_no_command_asks_for_nothing_a_stop_does_not_lock_for_ever() -> None:
    interlock = Interlock('', 1.0, has_neutral=False)
    assert interlock.may_send(PUSHED, None, True, 'emergency stop by b', 0) == 'emergency stop by b'
    assert interlock.may_send(PUSHED, None, True, '', 1) is None


@given(st.lists(st.tuples(st.sampled_from([None, PUSHED]), st.one_of(st.none(), st.floats()), st.booleans(),
                          st.sampled_from(['', 'x']), st.sampled_from([0, 0, 1]))))
def test_no_command_leaves_blindly_and_the_first_after_a_lock_is_neutral(commands: List[Tuple]) -> None:
    interlock, locked, releases = Interlock('thermal', 1.0), True, 0
    for deviation, age, clock_known, refusal, released in commands:
        releases, locked = releases + released, locked or bool(released)
        reason = interlock.may_send(deviation, age, clock_known, refusal, releases)
        if reason is None:
            assert age is not None and abs(age) <= 1.0 and clock_known and not refusal
            assert deviation is None or not locked
        locked = reason is not None
