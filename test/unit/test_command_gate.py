# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.checksum import typed_checksum
from smokebot_udp.teleop.command_copy import MAX_COMMAND_SIZE, Copy
from smokebot_udp.teleop.command_gate import TOLERANCE, Accepted, CommandGate

MD5SUM = '9f195f881246fdfa2798d1d3eebca84a'
OPERATOR, OTHER, ROBOT = 7, 8, 9
NOW = 100.0


def gate() -> CommandGate:
    made = CommandGate(ROBOT, MD5SUM, 0.3)
    made.rule(OPERATOR, False, 3, 10.0)
    return made


def copy(number: int = 1, made: float = NOW - 0.05, uncertainty: float = 0.01, data: bytes = b'twist',
         **fields: Any) -> Copy:
    """A copy that takes effect at NOW."""
    return Copy(OPERATOR, ROBOT, number, round(1e6 * made), round(1e6 * uncertainty), 3,
                typed_checksum(MD5SUM, data), data)._replace(**fields)


def test_a_fresh_command_takes_effect() -> None:
    tested = gate()
    assert tested.take(copy(), NOW) == Accepted(b'twist', pytest.approx(0.05, abs=1e-6))
    assert tested.accepted == 1 and not tested.dropped


@pytest.mark.parametrize('reason, refused', [
    ('another session', copy(robot=8)), ('another session', copy(robot=0)),
    ('type', copy(checksum=0)), ('type', copy(data=b'', checksum=typed_checksum('another type', b''))),
    ('too long', copy(data=bytes(MAX_COMMAND_SIZE + 1))),
    ('not in control', copy(session=OTHER)), ('not in control', copy(session=0)),
    ('too old', copy(made=NOW - 0.2901)), ('too old', copy(made=NOW - 0.1, uncertainty=0.2001)),
    ('too old', copy(made=NOW - 80, uncertainty=0)),
    ('from the future', copy(made=NOW + 0.0111)), ('from the future', copy(made=NOW + 1000, uncertainty=0.3)),
    ('from the future', copy(made=2 ** 64 / 1e6 - 1e6)),
    ('uncertain clock', copy(uncertainty=0.3001)),
    ('uncertain clock', copy(made=NOW + 1000, uncertainty=1000)),    # would be fresh at the earliest
    ('made before control', copy(made=10.01)), ('made before control', copy(releases=2)),
    ('too old', copy(made=10.0111))])
def test_a_copy_is_refused_and_counted_by_reason(reason: str, refused: Copy) -> None:
    tested = gate()
    assert tested.take(refused, NOW) is None
    assert tested.dropped == {reason: 1} and tested.accepted == 0
    assert tested.take(copy(), NOW) is not None     # and has no other effect


@pytest.mark.parametrize('made, uncertainty', [(NOW - 0.2899, 0.01), (NOW - 0.2999, 0.0), (NOW, 0.3),
                                               (NOW + 0.01, 0.01), (NOW + 0.2, 0.2)])
def test_the_largest_error_of_the_stamp_is_counted_in(made: float, uncertainty: float) -> None:
    assert gate().take(copy(made=made, uncertainty=uncertainty), NOW) is not None


def test_the_longest_command_fits() -> None:
    assert gate().take(copy(data=bytes(MAX_COMMAND_SIZE)), NOW) is not None


@pytest.mark.parametrize('first, second, reason', [
    (5, 5, 'repeated'), (5, 4, 'older than a newer one'), (5, 6, None), (5, 5 + 2 ** 31 - 1, None),
    (5, 5 + 2 ** 31, 'older than a newer one'), (2 ** 32 - 1, 0, None), (2 ** 32 - 1, 5, None),
    (0, 2 ** 32 - 1, 'older than a newer one')])
def test_numbers_compare_in_serial_arithmetic(first: int, second: int, reason: Optional[str]) -> None:
    tested = gate()
    assert tested.take(copy(first), NOW) is not None
    assert (tested.take(copy(second, data=b''), NOW) is None) == (reason is not None)
    assert tested.dropped == ({reason: 1} if reason else {})


def test_a_refused_command_does_not_count_as_the_newest() -> None:
    tested = gate()
    tested.take(copy(9, made=NOW - 1), NOW)
    tested.take(copy(9, session=OTHER), NOW)
    assert tested.take(copy(8), NOW) is not None


def test_a_forged_number_does_not_shut_out_the_operator() -> None:
    tested = gate()
    assert tested.take(copy(2 ** 31 - 1), NOW) is not None
    assert tested.take(copy(1), NOW) is None                                        # of before, perhaps
    assert tested.take(copy(2, made=NOW + 0.005), NOW + 0.06) is None               # perhaps, too
    assert tested.take(copy(3, made=NOW + 0.05), NOW + 0.1) is not None             # certainly made after it
    assert tested.take(copy(3, made=NOW + 0.05), NOW + 0.1) is None


def test_a_stamp_in_the_future_by_the_tolerance_does_not_make_a_copy_newer() -> None:
    tested, early = gate(), copy(2, made=NOW + 0.0109)
    assert tested.take(early, NOW) is not None
    assert tested.take(early, NOW + 0.01) is None and tested.take(early._replace(number=1), NOW + 0.01) is None


def test_a_forged_stamp_does_not_prolong_a_life() -> None:
    tested = gate()
    forged = copy(made=NOW + 0.3, uncertainty=0.3)
    assert gate().take(forged, NOW + 0.3) is not None and tested.take(forged, NOW + 0.301) is None
    assert tested.take(copy(made=NOW + 0.1, uncertainty=0.0), NOW) is None


@pytest.mark.parametrize('driver, estop, reason', [(0, False, 'not in control'), (OTHER, False, 'not in control'),
                                                   (OPERATOR, True, 'emergency stop')])
def test_what_was_made_before_the_driver_may_drive_again_is_void(driver: int, estop: bool, reason: str) -> None:
    tested = gate()
    tested.rule(driver, estop, 3, NOW - 0.04)
    assert tested.take(copy(), NOW) is None and tested.dropped == {reason: 1}
    tested.rule(OPERATOR, False, 3, NOW)
    for made in (NOW - 0.05, NOW - 0.01, NOW + 0.01):
        assert tested.take(copy(made=made), NOW + 0.05) is None
    assert tested.dropped == {reason: 1, 'made before control': 3}
    assert tested.take(copy(made=NOW + 0.012), NOW + 0.05) is not None


def test_who_has_not_heard_that_the_emergency_stop_was_released_moves_nothing() -> None:
    """It was engaged and released while the driver heard nothing, and a stick is still pushed."""
    tested = gate()
    tested.rule(OPERATOR, False, 4, NOW)
    for made in (NOW - 0.05, NOW + 0.012, NOW + 0.2):
        assert tested.take(copy(made=made), made + 0.05) is None
    assert tested.dropped == {'made before control': 3}
    assert tested.take(copy(made=NOW + 0.3, releases=4), NOW + 0.35) is not None


def test_what_waited_while_the_machine_was_suspended_is_void() -> None:
    tested = gate()
    tested.void(NOW)
    for made in (NOW - 0.05, NOW, NOW + 0.01):
        assert tested.take(copy(made=made), NOW + 0.05) is None
    assert tested.dropped == {'made before control': 3}
    assert tested.take(copy(made=NOW + 0.012), NOW + 0.05) is not None


def test_nobody_drives_a_new_node() -> None:
    tested = CommandGate(ROBOT, MD5SUM, 0.3)
    assert tested.take(copy(), NOW) is None and tested.take(copy(session=0), NOW) is None
    assert tested.dropped == {'not in control': 2}


def test_the_same_rule_again_voids_nothing() -> None:
    tested = gate()
    tested.rule(OPERATOR, False, 3, NOW)
    assert tested.take(copy(), NOW) is not None


def test_a_new_session_of_the_operator_begins_with_any_number() -> None:
    tested = gate()
    assert tested.take(copy(1000), NOW) is not None
    tested.rule(OTHER, False, 3, NOW + 0.01)
    assert tested.take(copy(1, made=NOW + 0.05, session=OTHER), NOW + 0.1) is not None
    assert tested.take(copy(1001, made=NOW + 0.05), NOW + 0.1) is None


def test_a_changed_max_age_has_effect_at_once() -> None:
    tested = gate()
    tested.max_age = 0.05
    assert tested.take(copy(), NOW) is None
    tested.max_age = 0.07
    assert tested.take(copy(), NOW) is not None


def test_threads_may_take_the_time_in_another_order() -> None:
    tested = gate()
    assert tested.take(copy(1), NOW) is not None
    assert tested.take(copy(2), NOW - 0.04) is not None
    assert tested.take(copy(3), NOW - 0.06) is None and tested.dropped == {'clock went back': 1}


def test_when_the_clock_has_caught_up_only_what_was_made_since_takes_effect() -> None:
    tested = gate()
    assert tested.take(copy(1), NOW) is not None
    assert tested.take(copy(2, made=NOW - 10), NOW - 9.95) is None
    assert tested.take(copy(2), NOW) is None                    # ten seconds old in truth
    assert tested.take(copy(3, made=NOW + 0.05), NOW + 0.1) is not None


copies = st.builds(copy, st.integers(0, 3) | st.integers(2 ** 32 - 2, 2 ** 32 - 1) | st.integers(0, 2 ** 32 - 1),
                   st.floats(NOW - 1, NOW + 2), st.floats(0, 0.4), session=st.sampled_from([0, OPERATOR, OTHER]),
                   robot=st.sampled_from([ROBOT] * 5 + [0]))
steps = st.lists(st.tuples(st.floats(0, 0.2), copies | st.integers(-100, -1),
                           st.sampled_from([None] * 8 + [(0, False), (OPERATOR, False), (OTHER, False),
                                                         (OPERATOR, True)])), max_size=60)


@given(steps)
def test_whatever_comes_nothing_old_takes_effect_and_nothing_twice(
        steps: List[Tuple[float, Any, Optional[Tuple[int, bool]]]]) -> None:
    """Copies of any content, and again ones that came before, while the driver changes."""
    tested, now, ruled, seen = gate(), NOW, (OPERATOR, False), [copy()]
    effective: List[Copy] = []
    for wait, what, rule in steps:
        now += wait
        if rule is not None:
            ruled = rule
            tested.rule(*rule, 3, now)
        taken = seen[what % len(seen)] if isinstance(what, int) else what
        seen.append(taken)
        before = sum(tested.dropped.values())
        if tested.take(taken, now) is None:
            assert sum(tested.dropped.values()) == before + 1
            continue
        assert (taken.session, False) == ruled and taken.robot == ROBOT
        earliest = (taken.made - taken.uncertainty) / 1e6
        assert earliest - TOLERANCE <= now <= earliest + 0.3 + 1e-6
        assert taken not in effective
        effective.append(taken)
    assert tested.accepted == len(effective)


@given(st.integers(0, 2 ** 32 - 1), st.permutations(range(30)), st.data())
def test_of_shuffled_commands_only_newer_ones_take_effect(first: int, order: List[int], data: st.DataObject) -> None:
    """Made 1 ms apart, at most: their stamps do not tell which is newer. Numbers wrap."""
    tested, effective = gate(), []
    for index in order:
        for _ in range(data.draw(st.integers(1, 3))):
            command = copy((first + index) % 2 ** 32, made=NOW - 0.05 + 1e-3 * index)
            if tested.take(command, NOW) is not None:
                effective.append(index)
    assert effective == sorted(set(effective)) and effective[-1] == 29


def test_memory_is_bounded() -> None:
    tested = gate()
    for i in range(20000):
        tested.take(copy(i, session=i, robot=ROBOT + i % 2), NOW)
    assert set(tested.dropped) <= {'not in control', 'another session', 'older than a newer one'}
