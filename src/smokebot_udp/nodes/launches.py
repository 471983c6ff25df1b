# SPDX-License-Identifier: BSD-3-Clause
"""Runs several roslaunch processes as children, each started again when it ends, and ends all with this process.

Nothing is left behind. A roslaunch that is killed leaves its nodes: they are ended before it is started again. If this
process itself is killed, the kernel interrupts its children, which end their nodes.
"""
import os
import signal
import subprocess
import time
from typing import Any, Callable, Mapping, Optional, Sequence

import rospy

from .child_process import end_family, new_mark, with_parent, words
from .restarts import Restarts

PERIOD = 0.2
"""How often it is looked whether one has ended [s]."""

END_TIMEOUT = 10.0
"""Those that take longer to end are killed; less than the 15 s that the roslaunch of this process waits [s]."""

LEFT_TIMEOUT = 2.0
"""Likewise for what a roslaunch has left behind [s]."""


class Launch:
    """One command that is kept running. Only the main thread uses it: the kernel interrupts the child when the thread
    that has started it ends.

    :param name: of what it runs, for the log
    :param command: with its arguments, interrupted to end it
    :param variables: environment variables that differ from this process's
    """

    def __init__(self, name: str, command: Sequence[str], variables: Optional[Mapping[str, str]] = None) -> None:
        self.name, self._command = name, command
        self._mark = new_mark()
        self._environment = {**os.environ, **(variables or {}), self._mark: '1'}
        self._restarts = Restarts()
        self._process: Any = None
        self._since, self._due = 0.0, 0.0

    def start(self, now: float) -> None:
        """Run it.

        :param now: time.monotonic() [s]
        """
        self._since = now
        self._process = subprocess.Popen(with_parent(self._command, 'INT'), env=self._environment,
                                         stdin=subprocess.DEVNULL, start_new_session=True)

    @property
    def running(self) -> bool:
        """Whether it has been started and has not ended."""
        return self._process is not None and self._process.poll() is None

    def keep(self, now: float) -> None:
        """Start it again if it has ended, after a while."""
        if self._process is None:
            if now >= self._due:
                self.start(now)
            return
        if self.running:
            return
        end_family(self._mark, LEFT_TIMEOUT)
        code, delay = self._process.returncode, self._restarts.delay(now - self._since)
        self._process, self._due = None, now + delay
        rospy.logwarn('%s has ended (%s): it is started again in %g s', self.name, words(code), delay)

    def interrupt(self) -> None:
        """Ask it to end."""
        if self.running:
            self._process.send_signal(signal.SIGINT)

    def end(self, deadline: float) -> None:
        """Return when it and all that it has started have ended.

        :param deadline: when it is killed, by time.monotonic() [s]
        """
        while self.running and time.monotonic() < deadline:
            time.sleep(PERIOD)
        end_family(self._mark, LEFT_TIMEOUT if time.monotonic() < deadline else 0.0)
        if self._process is not None:
            self._process.wait()


def end_all(launches: Sequence[Launch]) -> None:
    """End all of them together."""
    for launch in launches:
        launch.interrupt()
    deadline = time.monotonic() + END_TIMEOUT
    for launch in launches:
        launch.end(deadline)


def keep_all(launches: Sequence[Launch], is_over: Callable[[], bool]) -> None:
    """Keep all of them running until `is_over`, then end them."""
    try:
        while not is_over():
            for launch in launches:
                launch.keep(time.monotonic())
            time.sleep(PERIOD)
    finally:
        end_all(launches)


def end_own_launch() -> None:
    """End the roslaunch that started this node, as Ctrl-C does, and wait for it: a required node that ends by itself is
    reported in red as a failure."""
    if not rospy.is_shutdown():
        os.kill(os.getppid(), signal.SIGINT)
        rospy.spin()
