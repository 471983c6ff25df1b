# SPDX-License-Identifier: BSD-3-Clause
"""Nodes that a person runs in a terminal: how they begin and end at a bad link, and how they read single keys."""
import contextlib
import os
import signal
import socket
import sys
import termios
import threading
import traceback
import tty
from typing import Callable, Iterator

import rosgraph
import rospy

MASTER_TIMEOUT = 3.0
"""Limit for the master's answer at the start and at the end: over a cut link it would take minutes [s]."""

MASTER_ATTEMPTS = 3
"""How often the master is asked at the start: over a bad link an answer may be late."""

ENDING = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
"""Signals that end a program."""


def is_terminal() -> bool:
    """Whether a person can press keys and read."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def fail(program: str, problem: str) -> int:
    """Print why a program ends; returns its exit code."""
    print('%s: %s' % (program, problem), file=sys.stderr)
    return 1


def master_answers() -> bool:
    """Whether there is a master: rospy.init_node would wait for it forever."""
    socket.setdefaulttimeout(MASTER_TIMEOUT)
    try:
        return any(rosgraph.is_master_online() for _ in range(MASTER_ATTEMPTS))
    finally:
        socket.setdefaulttimeout(None)


def run_node(run: Callable[[], int]) -> None:
    """Run a node to its end and exit, whatever ends it.

    :param run: f() -> exit code
    """
    for number in ENDING:   # all must restore the terminal
        signal.signal(number, signal.default_int_handler)
    try:
        code = run()
    except (KeyboardInterrupt, BrokenPipeError):    # nobody reads on, as behind `| head`
        code = 0
    except Exception:
        traceback.print_exc()
        code = 1
    _exit_node(code)


def _exit_node(code: int) -> None:
    """Unregister from the master and exit, even if it does not answer."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    shutdown = threading.Thread(target=rospy.signal_shutdown, args=('ended',), daemon=True)
    shutdown.start()
    shutdown.join(MASTER_TIMEOUT)
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.flush()
    os._exit(code)


@contextlib.contextmanager
def single_keys(terminal: int) -> Iterator[None]:
    """A context in which a terminal gives each key at once and does not show it.

    :param terminal: its file descriptor
    """
    before = termios.tcgetattr(terminal)
    resumed = signal.getsignal(signal.SIGCONT)
    try:
        tty.setcbreak(terminal)
        # a shell that has stopped the program (Ctrl-Z) may have changed the terminal
        signal.signal(signal.SIGCONT, lambda *_: tty.setcbreak(terminal))
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)    # a second Ctrl-C
        signal.signal(signal.SIGCONT, resumed)
        with contextlib.suppress(termios.error):    # the terminal is closed
            termios.tcsetattr(terminal, termios.TCSAFLUSH, before)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
