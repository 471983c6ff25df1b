# SPDX-License-Identifier: BSD-3-Clause
"""ROS on both sides of a link lab: a master on the robot's side, and nodes that end with this process."""
import contextlib
import os
import pathlib
import signal
import subprocess
import time
from typing import Any, List, Optional

from smokebot_udp.link_lab.lab import Lab, environment

from . import processes

MASTER_TIMEOUT = 30.0
"""A master that has not answered by then never will [s]."""


class Stack:
    """A link lab with a ROS master; a context manager.

    :param seed, congestion_control: see Lab
    :param log: file for the output of the nodes; None: it is lost
    :raises LabError: as Lab
    """

    def __init__(self, seed: int = 0, congestion_control: str = 'cubic', log: Optional[pathlib.Path] = None) -> None:
        self._processes: List[subprocess.Popen[Any]] = []
        self._resources = contextlib.ExitStack()
        self._log = self._resources.enter_context(open(str(log or os.devnull), 'ab'))    # noqa: SIM115
        try:
            self.lab = self._resources.enter_context(Lab(seed, congestion_control))
            self.master = self.start_master()
            self._wait_for_master()
        except BaseException:
            self.close()
            raise

    def start(self, side: str, *command: str, **options: Any) -> 'subprocess.Popen[Any]':
        """Start a command on a side. It is killed when the stack is closed, or when this process ends.

        :param options: of subprocess.Popen
        """
        process = processes.start(self.lab.command(side, command), death_signal='KILL', **{
            'env': environment(side), 'stdout': self._log, 'stderr': self._log, 'start_new_session': True, **options})
        self._processes.append(process)
        return process

    def start_master(self) -> 'subprocess.Popen[Any]':
        """Start a master; `master` is the first one."""
        return self.start('robot', 'rosmaster', '--core')   # not roscore: its own children would outlive it

    def start_node(self, side: str, name: str, *arguments: str) -> 'subprocess.Popen[Any]':
        """Start one of this package's nodes."""
        return self.start(side, 'rosrun', 'smokebot_udp', name, '__name:=' + name, *arguments)

    def end(self, process: 'subprocess.Popen[Any]') -> None:
        """Kill a process of this stack. It cannot say goodbye to anybody, as in a power failure."""
        self._processes.remove(process)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()

    def _wait_for_master(self) -> None:
        deadline = time.monotonic() + MASTER_TIMEOUT
        while self.lab.run('robot', ['rosnode', 'list'], env=environment('robot'), stdout=subprocess.DEVNULL,
                           stderr=subprocess.DEVNULL).returncode:
            if time.monotonic() > deadline:
                raise RuntimeError('the ROS master does not answer')
            time.sleep(0.1)

    def close(self) -> None:
        """Kill all processes and remove the link."""
        for process in self._processes[::-1]:
            self.end(process)
        self._resources.close()

    def __enter__(self) -> 'Stack':
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()
