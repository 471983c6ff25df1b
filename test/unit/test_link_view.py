# SPDX-License-Identifier: BSD-3-Clause
import fcntl
import io
import os
import pty
import signal
import struct
import sys
import termios
import time
from typing import Any, Iterator, List

import pytest
from link_reports import SHOWN, board, report, stream
from polling import wait_for

from smokebot_udp import optional
from smokebot_udp.monitoring.history import ASCII_BARS
from smokebot_udp.monitoring.link_snapshot import Tree, snapshot
from smokebot_udp.nodes.link_top import VIEW as VIEW_MODULE

VIEW = optional.attempt(VIEW_MODULE, 'rich')
if VIEW.module is None:
    pytest.skip('%s: link_top has its plain table' % VIEW.problem, allow_module_level=True)
from rich.console import Console  # noqa: E402

from smokebot_udp.nodes import link_view  # noqa: E402


def rendered(trees: List[Tree], width: int = 220, **options: Any) -> str:
    """The view of the last of trees, taken 3 s apart."""
    view, file = link_view.LinkView(lambda: width, **options), io.StringIO()
    for second, tree in enumerate(trees):
        content = view.render(tree, 3.0 * second)
    Console(file=file, width=width).print(content)
    return file.getvalue()


def test_robots_operators_and_streams_are_apart() -> None:
    lines = [line.rstrip() for line in rendered([snapshot(board(), 0.5)]).splitlines()]
    assert lines[0] == 'smokebot_udp link: last report 0.5 s ago'
    expected = ['Robots', 'Operators', 'Wi-Fi', 'Streams of /robot_sender at /op', 'Streams of /alone', 'Connections']
    assert [line for line in lines if line in expected] == expected
    robot = next(line for line in lines if '/robot_sender' in line and 'EMERGENCY' in line)
    assert robot.startswith('WARN') and '4.4 ' in robot
    assert lines[lines.index('Wi-Fi') + 3].split() == [
        '/robot_sender', 'wlan0', 'net', '-60', '-', '65.0', '6.5', '12.0', '-', '-']
    assert lines[lines.index('Wi-Fi') + 4].split() == ['/op'] + 9 * ['-']
    operator = lines[lines.index('Operators') + 2]
    assert operator.split() == ['WARN', '/op', '/robot_sender', 'behind', 'by', '12.0', 'ms', '1.5']
    thermal = lines[lines.index('Streams of /robot_sender at /op') + 2]
    assert thermal.startswith('WARN') and thermal.endswith('400.0  operator: old')


def test_the_last_minute_is_plotted() -> None:
    trees = []
    for hertz in 0.0, 3.5, 7.0:
        made = board()
        made.add([stream('/op', 'operator', **{**SHOWN, 'rate out [Hz]': hertz})], 0.0)
        trees.append(snapshot(made, 0.5))
    assert '7.0 ' + ' ' * 17 + '▁▅█' in rendered(trees)
    assert '7.0 ' + ' ' * 17 + '_=#' in rendered(trees, bars=ASCII_BARS)
    assert '7.0 ' + ' ' * 4 + '█' in rendered(trees, width=100)


def test_no_colour_where_it_is_not_a_terminal_and_no_markup_of_others() -> None:
    made = board()
    made.add([report('/op', 'operator', 1, '[bold red]x[/]', problems=1)], 0.0)
    text = rendered([snapshot(made, 0.5)])
    assert '[bold red]x[/]' in text and '\x1b' not in text


@pytest.fixture
def terminal() -> Iterator[Any]:
    """f() -> (pid, a person's side of a terminal) of a process that shows a board."""
    started = []

    def start() -> Any:
        pid, person = pty.fork()
        if not pid:
            show_until_quit()
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


def show_until_quit() -> None:
    """In the process of the terminal: it ends by 0 if the view is quit, by 7 by Ctrl-C."""
    os.environ.update(TERM='xterm', LANG='C.UTF-8')
    fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack('HHHH', 12, 100, 0, 0))
    sys.stdin, sys.stdout = open(0), open(1, 'w', encoding='utf-8')     # noqa: SIM115: pytest replaces them
    signal.signal(signal.SIGINT, signal.default_int_handler)
    code = 9
    try:
        link_view.show(lambda: snapshot(board(), 0.5), time.monotonic, 0.05)
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
        text += os.read(person, 65536)
        return wanted in text
    wait_for(found)
    return text


@pytest.mark.parametrize('key, code', [(b'q', 0), (b'\x03', 7)])
def test_the_terminal_is_restored_at_the_end(terminal: Any, key: bytes, code: int) -> None:
    pid, person = terminal()
    shown = read_until(person, b'Robots')
    assert b'\x1b[?1049h' in shown      # the alternate screen
    os.write(person, key)
    read_until(person, b'\x1b[?1049l')
    status = os.waitpid(pid, 0)[1]
    assert os.WIFEXITED(status) and os.WEXITSTATUS(status) == code


def test_keys_scroll_and_the_window_may_change(terminal: Any) -> None:
    _, person = terminal()
    assert b'Connections' not in read_until(person, b'Robots')      # 12 lines
    os.write(person, b'\x1b[6~')
    read_until(person, b'Connections')
    os.write(person, b'\x1b[5~')
    read_until(person, b'last report')
    fcntl.ioctl(person, termios.TIOCSWINSZ, struct.pack('HHHH', 60, 200, 0, 0))
    read_until(person, b'Connections')
