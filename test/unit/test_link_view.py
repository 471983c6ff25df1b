# SPDX-License-Identifier: BSD-3-Clause
"""The live view of link_top in a terminal."""
import curses
import fcntl
import os
import pty
import re
import select
import signal
import struct
import sys
import termios
from typing import Any, Iterator, List

import pytest
from link_reports import LINK, SHOWN, board, report, stream
from polling import wait_for

from smokebot_udp.monitoring.link_snapshot import snapshot
from smokebot_udp.monitoring.link_table import STREAM_COLUMNS, render
from smokebot_udp.monitoring.plots import SPAN, Plots
from smokebot_udp.nodes import link_view


def table(plots: Plots) -> List[str]:
    return render(snapshot(board(), 0.5), plots=plots)


def test_the_last_minute_is_plotted_in_the_same_table() -> None:
    plots = Plots()
    for second, hertz in (0.0, 0.0), (SPAN / 20, 3.5), (SPAN / 10, 7.0):
        plots.begin(20, second)
        made = board()
        made.add([stream('/op', 'operator', **{**SHOWN, 'rate out [Hz]': hertz})], 0.0)
        made.add([report('link', '/robot_sender', 'robot', **{**LINK, 'sent [Mbit/s]': 2 * hertz})], 0.0)
        tree = snapshot(made, 0.5)
        lines = render(tree, plots=plots)
    bars = 17 * ' ' + '▁▅█'
    thermal = next(line for line in lines if line.startswith('OK     thermal') and '7.0' in line)
    assert ' 7.0 ' + bars in thermal and ' 12.5 ' + 17 * ' ' + '███' in thermal
    assert ': 14.0 %s of 5.0 Mbit/s sent, 77.0 wanted, - %s carried; queue 14 ' % (bars, 20 * ' ') in lines[1]
    without = next(line for line in render(tree) if line.startswith('OK     thermal') and '7.0' in line)
    assert re.sub(' [ ▁▅█]{20}', '', thermal) == without


def test_the_sparklines_of_a_wide_terminal_fit() -> None:
    width = sum(abs(column.width) + 1 for column in STREAM_COLUMNS)
    for columns, bars in link_view.ROOM:
        assert width + 3 * (bars + 1) <= columns


def test_long_names_are_whole_and_the_columns_stay_in_line() -> None:
    tree, name = snapshot(board(), 0.5), 'front_left_thermal_camera'
    tree['streams'][0]['stream'] = name
    lines = render(tree)
    heading = next(line for line in lines if line.startswith('LEVEL'))
    assert heading.index('SOURCE') > len('LEVEL  %s ' % name)
    assert any(line[7:].startswith(name + ' ') for line in lines)


@pytest.fixture
def terminal() -> Iterator[Any]:
    """f(columns, plain, **environment) -> (pid, a person's side of a terminal) of a process that shows a board."""
    started = []

    def start(columns: int = 100, plain: bool = False, **environment: str) -> Any:
        pid, person = pty.fork()
        if not pid:
            for name in ('LINES', 'COLUMNS'):   # as readline sets them, unseen by os.environ: curses would believe them
                os.unsetenv(name)
            os.environ.update(TERM='xterm', LANG='C.UTF-8', **environment)
            show_until_quit(columns, plain)
        started.append((pid, person))
        return pid, person
    yield start
    for pid, person in started:
        os.close(person)
        try:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        except (ProcessLookupError, ChildProcessError):
            pass


def show_until_quit(columns: int, plain: bool) -> None:
    """In the process of the terminal: it ends by 0 if the view is quit, by 7 by Ctrl-C."""
    fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack('HHHH', 12, columns, 0, 0))
    sys.stdin, sys.stdout = open(0), open(1, 'w', encoding='utf-8')     # noqa: SIM115: pytest replaces them
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGWINCH, signal.SIG_DFL)  # pytest's readline has a handler, and curses leaves that as it is
    code = 9
    try:
        curses.wrapper(link_view.show, table, plain)
        code = 0
    except KeyboardInterrupt:
        code = 7
    finally:
        sys.stdout.flush()
        os._exit(code)


def read_until(person: int, wanted: bytes) -> bytes:
    text = b''

    def found() -> bool:
        nonlocal text
        if select.select([person], [], [], 0.0)[0]:
            text += os.read(person, 65536)
        return wanted in text
    wait_for(found)
    return text


@pytest.mark.parametrize('key, code', [(b'q', 0), (b'\x03', 7)])
def test_the_terminal_is_restored_at_the_end(terminal: Any, key: bytes, code: int) -> None:
    pid, person = terminal()
    shown = read_until(person, b'LEVEL')
    assert b'\x1b[?1049h' in shown      # the alternate screen
    os.write(person, key)
    read_until(person, b'\x1b[?1049l')
    status = os.waitpid(pid, 0)[1]
    assert os.WIFEXITED(status) and os.WEXITSTATUS(status) == code


def test_keys_scroll_and_the_window_may_change(terminal: Any) -> None:
    _, person = terminal()
    assert b'DATAGRAMS' not in read_until(person, b'LEVEL')      # 12 lines
    os.write(person, 2 * b'\x1b[6~')
    read_until(person, b'DATAGRAMS')
    os.write(person, 2 * b'\x1b[5~')
    read_until(person, b'last report')
    fcntl.ioctl(person, termios.TIOCSWINSZ, struct.pack('HHHH', 60, 200, 0, 0))
    assert b'CAME' in read_until(person, b'DATAGRAMS')


@pytest.mark.parametrize('columns, plain, plotted', [(180, False, True), (180, True, False), (120, False, False)])
def test_sparklines_where_there_is_room_and_they_are_wanted(
        terminal: Any, columns: int, plain: bool, plotted: bool) -> None:
    _, person = terminal(columns, plain)
    assert ('█'.encode() in read_until(person, b'LEVEL')) == plotted


@pytest.mark.parametrize('environment, coloured', [({}, True), ({'NO_COLOR': '1'}, False)])
def test_colours_unless_they_are_not_wanted(terminal: Any, environment: Any, coloured: bool) -> None:
    _, person = terminal(**environment)
    assert (b'\x1b[32m' in read_until(person, b'LEVEL')) == coloured
