# SPDX-License-Identifier: BSD-3-Clause
"""ROS on both sides of a link lab: a master on the robot's side, and nodes that end with this process."""
import contextlib
import os
import pathlib
import signal
import subprocess
import time
from typing import Any, Dict, List, Optional, Sequence, TypeVar

from smokebot_udp.link_lab.lab import ADDRESSES, DEVICE, Lab, TwoSides, environment

from . import processes

Own = TypeVar('Own', bound='Stack')

MASTER_TIMEOUT = 30.0
"""A master that has not answered by then never will [s]."""

OPERATOR_ADDRESSES = ADDRESSES['operator'], '10.77.0.3'
"""Which the operator may have, see Stack.change_address."""


SENDER, RECEIVER = 'robot_sender', 'operator_receiver'


class Stack:
    """A link lab with a ROS master; a context manager.

    :cvar MASTER_SIDES: those that have a master
    :param seed, congestion_control, shared_air: see Lab
    :param log: file for the output of the nodes; None: it is lost
    :param sides: another link, in place of a link lab; it is removed with the stack
    :raises LabError: as Lab
    """

    MASTER_SIDES: Sequence[str] = ('robot',)

    def __init__(self, seed: int = 0, congestion_control: str = 'cubic', log: Optional[pathlib.Path] = None,
                 shared_air: bool = False, sides: Optional[TwoSides] = None) -> None:
        self._processes: List[subprocess.Popen[Any]] = []
        self._resources = contextlib.ExitStack()
        self.variables: Dict[str, str] = {}
        """Environment variables of the processes that are started from now on, besides those of their side."""
        self.operator_address = OPERATOR_ADDRESSES[0]
        self._log = self._resources.enter_context(open(str(log or os.devnull), 'ab'))    # noqa: SIM115
        try:
            self.lab: Any = self._resources.enter_context(sides or Lab(seed, congestion_control, shared_air))
            self.masters = {side: self.start_master(side) for side in self.MASTER_SIDES}
            for side in self.masters:
                self._wait_for_master(side)
        except BaseException:
            self.close()
            raise

    def environment(self, side: str) -> Dict[str, str]:
        """The environment of ROS nodes on a side."""
        return environment(side)

    def start(self, side: str, *command: str, **options: Any) -> 'subprocess.Popen[Any]':
        """Start a command on a side. It is killed when the stack is closed, or when this process ends.

        :param options: of subprocess.Popen
        """
        # what is waited for in a log must not stay in a buffer
        process = processes.start(self.lab.command(side, command), death_signal='KILL', **{
            'env': {**self.environment(side), 'PYTHONUNBUFFERED': '1', **self.variables},
            'stdout': self._log, 'stderr': self._log, 'start_new_session': True, **options})
        self._processes.append(process)
        return process

    def start_master(self, side: str = 'robot') -> 'subprocess.Popen[Any]':
        """Start a side's master; `masters` are the first ones."""
        return self.start(side, 'rosmaster', '--core')   # not roscore: its own children would outlive it

    def start_node(self, side: str, name: str, *arguments: str) -> 'subprocess.Popen[Any]':
        """Start one of this package's nodes."""
        return self.start(side, 'rosrun', 'smokebot_udp', name, '__name:=' + name, *arguments)

    def start_sender(self, *arguments: str) -> 'subprocess.Popen[Any]':
        """Start robot_sender."""
        return self.start_node('robot', SENDER, *arguments)

    def start_receiver(self, *arguments: str) -> 'subprocess.Popen[Any]':
        """Start operator_receiver, which joins the robot."""
        return self.start_node('operator', RECEIVER, *arguments)

    def end(self, process: 'subprocess.Popen[Any]') -> None:
        """Kill a process of this stack. It cannot say goodbye to anybody, as in a power failure."""
        self._processes.remove(process)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()

    def change_address(self) -> None:
        """Give the operator its other address; the old one is gone."""
        old, peer = self.operator_address, ADDRESSES['robot']
        self.operator_address = next(address for address in OPERATOR_ADDRESSES if address != old)
        self.ip('robot', 'route replace %s dev %s' % (self.operator_address, DEVICE))
        self.ip('operator', 'addr del %s peer %s dev %s' % (old, peer, DEVICE))
        self.ip('operator', 'addr add %s peer %s dev %s' % (self.operator_address, peer, DEVICE))

    def set_parameter(self, name: str, value: bool) -> None:
        """Set a parameter at the robot's master."""
        self.lab.run('robot', ['rosparam', 'set', name, str(value).lower()], env=self.environment('robot'), check=True)

    def ip(self, side: str, line: str) -> None:
        """Run the command `ip` on a side."""
        self.lab.run(side, ['ip', *line.split()], check=True)

    def _wait_for_master(self, side: str) -> None:
        deadline = time.monotonic() + MASTER_TIMEOUT
        while self.lab.run(side, ['rosnode', 'list'], env=self.environment(side), stdout=subprocess.DEVNULL,
                           stderr=subprocess.DEVNULL).returncode:
            if time.monotonic() > deadline:
                raise RuntimeError('the ROS master does not answer')
            time.sleep(0.1)

    def end_all(self) -> None:
        """Kill all processes."""
        for process in self._processes[::-1]:
            self.end(process)

    def close(self) -> None:
        """Kill all processes and remove the link."""
        self.end_all()
        self._resources.close()

    def __enter__(self: Own) -> Own:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()
