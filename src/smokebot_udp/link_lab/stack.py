# SPDX-License-Identifier: BSD-3-Clause
"""ROS on both sides of a lab: a master on the robot's side, and nodes that end with it, however it ends."""
import contextlib
import os
import signal
import subprocess
import time

from .lab import Lab, environment

MASTER_ANSWERS = 30.0
"""A master that does not answer for so long will not [s]."""


class Stack:
    """A context manager.

    :param seed, congestion_control: the Lab's
    :param log: path of a file that gets what the nodes say; None: nobody hears it
    :raises LabError: as Lab
    """

    def __init__(self, seed=0, congestion_control='cubic', log=None):
        self._processes = []
        self._held = contextlib.ExitStack()
        self._log = self._held.enter_context(open(str(log or os.devnull), 'ab'))    # noqa: SIM115
        try:
            self.lab = self._held.enter_context(Lab(seed, congestion_control))
            # not roscore: its own children would outlive it
            self.start('robot', 'rosmaster', '--core')
            self._wait_for_the_master()
        except BaseException:
            self.close()
            raise

    def start(self, side, *command, **options):
        """Start a command on a side: a subprocess.Popen. It dies when the stack is closed, or this process dies."""
        process = subprocess.Popen(['setpriv', '--pdeathsig', 'KILL', *self.lab.command(side, command)], **{
            'env': environment(side), 'stdin': subprocess.DEVNULL, 'stdout': self._log, 'stderr': self._log,
            'start_new_session': True, **options})
        self._processes.append(process)
        return process

    def start_node(self, side, name, *arguments):
        """Start one of this package's nodes."""
        return self.start(side, 'rosrun', 'smokebot_udp', name, '__name:=' + name, *arguments)

    def end(self, process):
        """Kill a process that was started here: it has no time for a last word to anybody, as where power fails."""
        self._processes.remove(process)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()

    def _wait_for_the_master(self):
        deadline = time.monotonic() + MASTER_ANSWERS
        while self.lab.run('robot', ['rosnode', 'list'], env=environment('robot'), stdout=subprocess.DEVNULL,
                           stderr=subprocess.DEVNULL).returncode:
            if time.monotonic() > deadline:
                raise RuntimeError('the ROS master does not answer')
            time.sleep(0.1)

    def close(self):
        for process in self._processes[::-1]:
            self.end(process)
        self._held.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
