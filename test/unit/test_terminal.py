# SPDX-License-Identifier: BSD-3-Clause
"""A terminal is as before, whatever happens; integration/test_teleop_keyboard.py has signals."""
import os
import signal
import termios
from typing import Any, Iterator, Tuple

import pytest

from smokebot_udp.nodes.terminal import fail, single_keys

LOCAL_FLAGS = 3     # in what tcgetattr returns


@pytest.fixture
def terminal() -> Iterator[Tuple[int, int]]:
    person, program = os.openpty()
    yield person, program
    os.close(person)
    os.close(program)


def echoes(terminal: int) -> bool:
    return bool(termios.tcgetattr(terminal)[LOCAL_FLAGS] & termios.ECHO)


def test_keys_come_at_once_and_the_terminal_is_restored_after_an_exception(terminal: Any) -> None:
    person, program = terminal
    before = termios.tcgetattr(program)
    with pytest.raises(ZeroDivisionError), single_keys(program):
        assert not echoes(program)
        os.write(person, b'i')      # no line end
        assert os.read(program, 10) == b'i'
        raise ZeroDivisionError
    assert termios.tcgetattr(program) == before and echoes(program)


def test_keys_come_at_once_after_the_shell_has_stopped_and_resumed_it(terminal: Any) -> None:
    _, program = terminal
    before, handler = termios.tcgetattr(program), signal.getsignal(signal.SIGCONT)
    with single_keys(program):
        termios.tcsetattr(program, termios.TCSANOW, before)     # as a shell does
        os.kill(os.getpid(), signal.SIGCONT)
        assert not echoes(program)
    assert echoes(program) and signal.getsignal(signal.SIGCONT) == handler


def test_a_closed_terminal_is_no_error_at_the_end() -> None:
    person, program = os.openpty()
    with single_keys(program):
        os.close(person)
        os.close(program)


def test_a_failure_is_one_line(capsys: Any) -> None:
    assert fail('teleop_keyboard', 'no ROS master answers') == 1
    assert capsys.readouterr().err == 'teleop_keyboard: no ROS master answers\n'
