# SPDX-License-Identifier: BSD-3-Clause
"""Driving by the keyboard; integration/driving.test runs the node in a terminal."""
import math
from typing import List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.keyboard import (
    KEY_TIMEOUT,
    MOVES,
    PERIOD,
    REPEAT_TIMEOUT,
    STOP,
    STOP_DURATION,
    KeyAction,
    Keyboard,
    StopKey,
    Velocity,
)
from smokebot_udp.teleop.keyboard_screen import status_lines
from smokebot_udp.teleop.keys import TIMEOUT, Keys


def sent(keyboard: Keyboard, since: float, until: float) -> List[Tuple[float, Velocity]]:
    """[(when, command)] as a runner that waits for the deadlines."""
    found, now = [], since
    while now < until:
        command = keyboard.poll(now)
        if command is not None:
            found.append((now, command))
        due = keyboard.deadline()
        if due is None:
            break
        now = max(now, due)
    return found


def driven(keyboard: Keyboard, since: float, until: float) -> List[Velocity]:
    return [command for _, command in sent(keyboard, since, until)]


@pytest.mark.parametrize('key,expected', [
    ('i', (0.5, 0, 0, 0)), (',', (-0.5, 0, 0, 0)), ('j', (0, 0, 0, 1.0)), ('l', (0, 0, 0, -1.0)),
    ('u', (0.5, 0, 0, 1.0)), ('o', (0.5, 0, 0, -1.0)), ('m', (-0.5, 0, 0, -1.0)), ('.', (-0.5, 0, 0, 1.0)),
    ('J', (0, 0.5, 0, 0)), ('L', (0, -0.5, 0, 0)), ('t', (0, 0, 0.5, 0)), ('b', (0, 0, -0.5, 0))])
def test_keys_move_as_those_of_teleop_twist_keyboard(key: str, expected: Tuple[float, ...]) -> None:
    keyboard = Keyboard(0.5, 1.0)
    assert keyboard.press(key, 10.0) is None
    assert keyboard.poll(10.0) == expected


def test_a_key_pressed_once_moves_for_its_timeout_then_stops_then_is_silent() -> None:
    keyboard = Keyboard(0.5, 1.0, key_timeout=0.75, period=0.125)
    keyboard.press('i', 10.0)
    commands = sent(keyboard, 10.0, 20.0)
    moving = [when for when, command in commands if command.x]
    stopping = [when for when, command in commands if command == STOP]
    assert moving == [10.0 + 0.125 * number for number in range(6)]
    assert stopping == [10.75 + 0.125 * number for number in range(int(STOP_DURATION / 0.125))]
    assert keyboard.poll(12.0) is None and keyboard.deadline() is None


def test_a_key_that_is_held_moves_without_a_break_and_stops_soon_after_its_release() -> None:
    keyboard, commands = Keyboard(0.5, 1.0), []
    presses = [10.0, 10.5] + [10.5 + 0.04 * number for number in range(1, 50)]
    for press, following in zip(presses, presses[1:] + [20.0]):
        keyboard.press('i', press)
        commands += sent(keyboard, press, following)
    first_stop = next(when for when, command in commands if command == STOP)
    assert first_stop == pytest.approx(presses[-1] + REPEAT_TIMEOUT)
    gaps = [after - before for (before, _), (after, _) in zip(commands, commands[1:])]
    assert max(gaps) < PERIOD + 0.041 and min(gaps[:-6]) > PERIOD - 1e-6


def test_a_tap_after_a_tap_does_not_shorten_the_motion() -> None:
    keyboard = Keyboard(0.5, 1.0)
    keyboard.press('i', 10.0)
    keyboard.press('i', 10.1)
    assert driven(keyboard, 10.1, 10.0 + KEY_TIMEOUT - 0.01)[-1].x == 0.5


def test_another_direction_takes_effect_at_once() -> None:
    keyboard = Keyboard(0.5, 1.0)
    keyboard.press('i', 10.0)
    assert keyboard.poll(10.0) == (0.5, 0, 0, 0)
    keyboard.press('j', 10.02)
    assert keyboard.poll(10.02) == (0, 0, 0, 1.0)


@pytest.mark.parametrize('key', ['k', ' ', 'y', '\x1b', '\n'])
def test_any_other_key_stops(key: str) -> None:
    keyboard = Keyboard(0.5, 1.0)
    keyboard.press('i', 10.0)
    keyboard.poll(10.0)
    assert keyboard.press(key, 10.01) is None and keyboard.poll(10.01) == STOP
    assert set(driven(keyboard, 10.02, 20.0)) == {STOP}


@pytest.mark.parametrize('key,expected', [('q', (0.55, 1.1)), ('z', (0.45, 0.9)), ('w', (0.55, 1.0)),
                                          ('x', (0.45, 1.0)), ('e', (0.5, 1.1)), ('c', (0.5, 0.9))])
def test_speeds_change_by_a_tenth_also_on_the_way(key: str, expected: Tuple[float, float]) -> None:
    keyboard = Keyboard(0.5, 1.0)
    keyboard.press('u', 10.0)
    keyboard.press(key, 10.1)
    assert (keyboard.speed, keyboard.turn) == pytest.approx(expected)
    assert keyboard.poll(10.1) == pytest.approx((expected[0], 0, 0, expected[1]))
    for _ in range(200):
        keyboard.press(key, 10.2)
    assert 0.01 <= keyboard.speed <= 10.0 and 0.01 <= keyboard.turn <= 10.0


@pytest.mark.parametrize('key,wish', [('s', KeyAction.EMERGENCY_STOP), ('R', KeyAction.RELEASE_EMERGENCY_STOP),
                                      ('T', KeyAction.TAKE_CONTROL), ('G', KeyAction.RELEASE_CONTROL)])
def test_wishes_stop_the_robot_and_move_nothing(key: str, wish: KeyAction) -> None:
    keyboard = Keyboard(0.5, 1.0)
    keyboard.press('i', 10.0)
    assert keyboard.press(key, 10.1) is wish and keyboard.poll(10.1) == STOP and key not in MOVES


def wishes(*typed: str) -> List[KeyAction]:
    """What is asked for by what is read at once, one after the other."""
    keys, keyboard = Keys(), Keyboard(0.5, 1.0)
    asked = [keyboard.press(key, 10.0) for text in typed for key in keys.take(text, 10.0)]
    return [wish for wish in asked if wish is not None]


@pytest.mark.parametrize('typed,keys', [
    ('ij\x1bOR', ['i', 'j', '\x1bOR']), ('ii', ['i', 'i']),
    ('\x1b[As', ['\x1b[A', 's']),                  # an arrow
    ('\x1b[1;5Csi', ['\x1b[1;5C', 's', 'i']),      # an arrow with Ctrl
    ('\x1b[15~R', ['\x1b[15~', 'R']),              # F5
    ('\x1bO5Ri', ['\x1bO5R', 'i']),                # F3 with Ctrl, as some terminals have it
    ('\x1b[1;2Ri', ['\x1b[1;2R', 'i']), ('\x1b[?62;c', ['\x1b[?62;c']), ('\x1b(Bi', ['\x1b(B', 'i']),
    ('\x1bii', ['\x1bi', 'i']),                    # Alt
    ('\x1b\x1b[Ai', ['\x1b', '\x1b[A', 'i']), ('i\x1b', ['i', '\x1b']), ('\x1b[', ['\x1b[']),
    ('\x1b[\ni', ['\x1b', '[', '\n', 'i']), ('\x1b ', ['\x1b ']), ('', [])])
def test_escape_sequences_have_a_grammar(typed: str, keys: List[str]) -> None:
    assert Keys().take(typed, 10.0) == keys


def test_a_sequence_in_pieces_is_one_and_its_beginning_is_a_key_already() -> None:
    keys = Keys()
    assert [keys.take(text, 10.0 + TIMEOUT / 8 * number) for number, text in enumerate(['\x1b', '[', '1;', '5Ci'])] == [
        ['\x1b'], ['\x1b['], ['\x1b[1;'], ['\x1b[1;5C', 'i']]
    assert keys.take('\x1b', 11.0) == ['\x1b']
    assert keys.take('i', 11.1 + TIMEOUT) == ['i']       # the key Escape, and another one


def test_an_escape_sequence_asks_for_nothing_and_stops() -> None:
    keyboard = Keyboard(0.5, 1.0)
    assert [keyboard.press(key, 10.0) for key in Keys().take('i\x1bOR', 10.0)] == [None, None]    # F3: R releases
    assert keyboard.poll(10.0) == STOP


@pytest.mark.parametrize('typed', [['s '], [' s'], ['\x1b[As'], ['\x1bOAs'], ['\x1b', 's'], ['\x1b[', 's'],
                                   ['\x1bO', 's'], ['\x1bs'], ['S'], ['sR'], ['is'], ['si'], ['\x1b[1;5', 'As']])
def test_the_stop_key_counts_whatever_is_read_with_it(typed: List[str]) -> None:
    assert wishes(*typed).count(KeyAction.EMERGENCY_STOP) == 1


@given(st.lists(st.text(st.sampled_from('sRi [O1;A\x1b~\x7f\u20ac'), max_size=6), max_size=6))
def test_no_stop_key_is_ever_lost_and_no_key_is_invented(typed: List[str]) -> None:
    asked = wishes(*typed)
    assert asked.count(KeyAction.EMERGENCY_STOP) == ''.join(typed).count('s')
    assert asked.count(KeyAction.RELEASE_EMERGENCY_STOP) <= ''.join(typed).count('R')


def test_the_stop_is_repeated_until_it_was_received_for_a_while_or_is_released() -> None:
    key = StopKey()
    assert not key.poll(True, 10.0) and key.deadline() == math.inf
    key.press(10.0)
    times = [10.0 + number / 16 for number in range(64)]
    found = [now for now in times if key.poll(now >= 12.0, now)]
    assert found[0] == 10.0 and found[-1] == pytest.approx(12.0 + STOP_DURATION, abs=PERIOD + 1 / 16)
    assert max(after - before for before, after in zip(found, found[1:])) <= PERIOD + 1 / 16
    assert key.deadline() == math.inf
    key.press(20.0)
    assert key.poll(True, 20.0)
    key.release()
    assert not key.poll(True, 20.2)


@given(st.lists(st.tuples(st.sampled_from('ijlu,mqzwxeck sRT'), st.floats(0.0, 2.0)), max_size=40))
def test_nothing_moves_for_longer_than_the_timeout_after_a_key(keys: List[Tuple[str, float]]) -> None:
    keyboard, now = Keyboard(0.5, 1.0), 0.0
    last: Optional[float] = None
    for key, pause in keys:
        keyboard.press(key, now)
        last = now if key in MOVES else last
        for when, command in sent(keyboard, now, now + pause):
            assert command == STOP or (last is not None and when < last + KEY_TIMEOUT)
        now += pause


def test_the_screen_says_who_drives_or_that_nobody_listens() -> None:
    keyboard = Keyboard(0.5, 1.0)
    keyboard.press('u', 10.0)
    keyboard.poll(10.0)
    first, second, third = status_lines(keyboard, '/operator/cmd_vel', 1, 'LOCKED: thermal is 2.3 s old', 'note', 200)
    assert first == 'speed 0.50 m/s  turn 1.00 rad/s | x +0.50  y +0.00  z +0.00  turn +1.00'
    assert (second, third) == ('LOCKED: thermal is 2.3 s old', 'note')
    nobody = status_lines(Keyboard(0.5, 1.0), '/ugv1/operator/cmd_vel', 0, 'in control', '', 200)
    assert nobody[0].endswith('standing') and nobody[1].startswith('NOBODY RECEIVES /ugv1/operator/cmd_vel')
    assert [len(line) for line in status_lines(keyboard, '/operator/cmd_vel', 0, '', '', 20)] == [19, 19, 0]
