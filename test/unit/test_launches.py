# SPDX-License-Identifier: BSD-3-Clause
"""Processes that are kept running, with those that they leave behind: real ones."""
import os
import pathlib
import signal
import subprocess
import sys
import time
from typing import Any, Iterator, List

import psutil
import pytest
from polling import wait_for

from smokebot_udp.nodes import launches
from smokebot_udp.nodes.child_process import family, new_mark, with_parent
from smokebot_udp.nodes.launches import Launch, end_all, keep_all

NODE = "import os, pathlib, sys, time; %s; pathlib.Path(sys.argv[1], str(os.getpid())).touch(); time.sleep(600)"
STUBBORN = 'import signal; [signal.signal(one, signal.SIG_IGN) for one in (signal.SIGINT, signal.SIGTERM)]'
LAUNCH = """
import signal, subprocess, sys
nodes = [subprocess.Popen([sys.executable, '-c', code, sys.argv[1]], start_new_session=True) for code in sys.argv[2:]]
def end(*_):
    for node in nodes:
        node.send_signal(signal.SIGINT)
    sys.exit()
signal.signal(signal.SIGINT, end)
signal.pause()
"""
"""Starts nodes in sessions of their own, as roslaunch does."""

DESK = """
import signal, sys, time
for number in (signal.SIGHUP, signal.SIGINT):   # who runs the tests may ignore them: nohup, a job in the background
    signal.signal(number, signal.SIG_DFL)
from smokebot_udp.nodes.launches import Launch, keep_all
keep_all([Launch('one', sys.argv[1:])], lambda: False)
"""


class Nodes:
    """The nodes of a launch, which write their process ids into a folder."""

    def __init__(self, folder: pathlib.Path) -> None:
        self._folder = folder

    def command(self, *first_lines: str) -> List[str]:
        return [sys.executable, '-c', LAUNCH, str(self._folder), *(NODE % line for line in first_lines)]

    def all(self) -> List[int]:
        return sorted(int(path.name) for path in self._folder.iterdir())

    def living(self) -> List[int]:
        return [pid for pid in self.all() if psutil.pid_exists(pid)
                and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE]

    def parent(self) -> int:
        return psutil.Process(self.living()[0]).ppid()


@pytest.fixture
def nodes(tmp_path: pathlib.Path) -> Iterator[Nodes]:
    made = Nodes(tmp_path)
    yield made
    for pid in made.living():
        os.kill(pid, signal.SIGKILL)


def test_what_a_killed_launch_leaves_is_ended_before_it_is_started_again(nodes: Nodes, monkeypatch: Any) -> None:
    logged: List[str] = []
    monkeypatch.setattr('rospy.logwarn', lambda text, *args: logged.append(text % args))
    launch = Launch("robot 'ugv1'", nodes.command('pass', 'pass'))
    now = time.monotonic()
    launch.keep(now)
    first = wait_for(lambda: len(nodes.living()) == 2 and nodes.living())
    os.kill(nodes.parent(), signal.SIGKILL)
    wait_for(lambda: not launch.running)
    assert nodes.living() == first
    launch.keep(now + 3)
    assert nodes.living() == [] and logged == ["robot 'ugv1' has ended (SIGKILL): it is started again in 1 s"]
    launch.keep(now + 3.9)
    assert not launch.running
    launch.keep(now + 4)
    assert len(wait_for(lambda: len(nodes.living()) == 2 and nodes.living())) == 2
    end_all([launch])
    assert nodes.living() == []


def test_those_that_do_not_end_are_killed(nodes: Nodes, monkeypatch: Any) -> None:
    monkeypatch.setattr(launches, 'END_TIMEOUT', 1.0)
    monkeypatch.setattr(launches, 'LEFT_TIMEOUT', 0.5)
    stubborn = [Launch('a', nodes.command(STUBBORN)), Launch('b', [sys.executable, '-c', NODE % STUBBORN,
                                                                   nodes.command()[-1]])]
    rounds = iter(lambda: len(nodes.living()) == 2, None)
    keep_all(stubborn, lambda: next(rounds))
    assert len(nodes.all()) == 2 and nodes.living() == []


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGHUP])
def test_all_end_with_this_process_however_it_ends(nodes: Nodes, number: int) -> None:
    desk = subprocess.Popen([sys.executable, '-c', DESK, *nodes.command('pass', 'pass')])
    wait_for(lambda: len(nodes.living()) == 2)
    desk.send_signal(number)
    assert desk.wait(60) == -number
    wait_for(lambda: not nodes.living())


def test_a_command_that_cannot_start_is_started_again_later(monkeypatch: Any) -> None:
    logged: List[str] = []
    monkeypatch.setattr('rospy.logwarn', lambda text, *args: logged.append(text % args))
    launch, now = Launch('robot', ['/no/such/program']), 0.0
    for _ in range(3):
        launch.keep(now)
        wait_for(lambda: not launch.running)
        launch.keep(now)
        now += 10.0 - 1e-3
    assert logged == ['robot has ended (exit code 127): it is started again in %d s' % delay for delay in (1, 2, 4)]


def test_a_family_within_a_family_belongs_to_both() -> None:
    inner, outer = new_mark(), new_mark()
    child = subprocess.Popen(with_parent(['sleep', '600'], 'KILL'), env={**os.environ, inner: '1', outer: '1'})
    try:
        # while it begins as another program it has no environment
        wait_for(lambda: family(inner) == family(outer) == [child.pid])
        assert family(new_mark()) == []
    finally:
        child.kill()
        child.wait()
    assert family(inner) == []
