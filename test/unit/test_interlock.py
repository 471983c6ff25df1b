# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.interlock import CLOCK_UNKNOWN, START_FROM_ZERO, Interlock

OLD, NONE, DRIVES = 'thermal is 1.5 s old', 'no image of thermal', 'b drives'

Step = Tuple[bool, Optional[float], bool, str, Optional[str]]


@pytest.mark.parametrize('steps', [
    # zero, age of the view, clock known, refusal; why it is not sent
    [(True, None, True, '', NONE), (False, 0.1, True, '', START_FROM_ZERO), (True, 0.1, True, '', None),
     (False, 0.1, True, '', None)],
    [(True, 0.1, True, '', None), (False, 1.0, True, '', None), (False, 1.5, True, '', OLD),
     (True, 1.5, True, '', OLD), (False, 0.1, True, '', START_FROM_ZERO), (False, 0.1, True, '', START_FROM_ZERO),
     (True, 0.1, True, '', None), (False, 0.1, True, '', None)],
    [(True, 0.1, True, '', None), (False, 0.1, False, '', CLOCK_UNKNOWN), (False, 0.1, True, DRIVES, DRIVES),
     (False, 0.1, True, '', START_FROM_ZERO), (True, 0.1, True, '', None)],
    [(True, 1.5, False, DRIVES, OLD), (True, 0.1, False, DRIVES, CLOCK_UNKNOWN)],
    [(True, math.nan, True, '', 'thermal is nan s old'), (True, -5.0, True, '', 'thermal is -5.0 s old')],
])
def test_after_a_lock_only_a_zero_command_opens(steps: List[Step]) -> None:
    interlock = Interlock('thermal', 1.0)
    for zero, age, clock_known, refusal, reason in steps:
        assert interlock.may_send(zero, age, clock_known, refusal) == reason


def test_a_lock_without_commands_counts() -> None:
    interlock = Interlock('thermal', 1.0)
    assert interlock.may_send(True, 0.1, True, '') is None and interlock.look(0.1, True, '') is None
    assert interlock.look(1.5, True, '') == OLD
    assert interlock.look(0.1, True, '') == START_FROM_ZERO
    assert interlock.may_send(False, 0.1, True, '') == START_FROM_ZERO
    assert interlock.may_send(True, 0.1, True, '') is None and interlock.look(0.1, True, '') is None


def test_without_a_required_image_commands_are_only_kept_back() -> None:
    interlock = Interlock('', 1.0)
    for age in (None, 0.1, 1000.0):
        assert interlock.may_send(False, age, True, '') is None
        assert interlock.may_send(False, age, False, '') == CLOCK_UNKNOWN
        assert interlock.may_send(False, age, True, DRIVES) == DRIVES
    assert interlock.may_send(False, None, True, '') is None


def test_the_limit_may_change() -> None:
    interlock = Interlock('thermal', 1.0)
    assert interlock.may_send(True, 0.9, True, '') is None
    interlock.max_view_age = 0.5
    assert interlock.may_send(True, 0.9, True, '') == 'thermal is 0.9 s old'


@given(st.lists(st.tuples(st.booleans(), st.one_of(st.none(), st.floats()), st.booleans(), st.sampled_from(['', 'x']))))
def test_no_command_leaves_blindly_and_the_first_after_a_lock_is_zero(commands: List[Tuple]) -> None:
    interlock, locked = Interlock('thermal', 1.0), True
    for zero, age, clock_known, refusal in commands:
        reason = interlock.may_send(zero, age, clock_known, refusal)
        if reason is None:
            assert age is not None and abs(age) <= 1.0 and clock_known and not refusal and (zero or not locked)
        locked = reason is not None
