# SPDX-License-Identifier: BSD-3-Clause
"""Child processes that end with their parent, among them a ROS master and peers that obey lines on stdin."""
import os
import select
import shutil
import socket
import subprocess
import tempfile
import time
import xmlrpc.client
from typing import Any, Sequence

from smokebot_udp.nodes.child_process import with_parent

END_TIMEOUT = 5.0
"""A process that is asked to end is killed after this time [s]."""


def start(command: Sequence[str], death_signal: str = 'TERM', **options: Any) -> 'subprocess.Popen[Any]':
    """Start a process that gets a signal when this one ends, however this one ends.

    :param death_signal: see with_parent
    :param options: of subprocess.Popen; without them there is neither input nor output
    """
    return subprocess.Popen(with_parent(command, death_signal), **{
        'stdin': subprocess.DEVNULL, 'stdout': subprocess.DEVNULL, 'stderr': subprocess.DEVNULL, **options})


def end(*processes: 'subprocess.Popen[Any]') -> None:
    """End processes together; kill those that take longer than END_TIMEOUT."""
    for process in processes:
        process.terminate()
    for process in processes:
        try:
            process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def free_port() -> int:
    """A TCP port of this machine that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


class Peer:
    """A process that answers each line on its stdin by one on its stdout.

    :param options: of subprocess.Popen
    """

    def __init__(self, command: Sequence[str], **options: Any) -> None:
        self._process = start(command, **{**options, 'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE,
                                          'universal_newlines': True, 'bufsize': 1})
        self.pid = self._process.pid

    def line(self, timeout: float = 60.0) -> str:
        """The next line it writes, without its end.

        :param timeout: [s]
        :raises RuntimeError: where none comes
        """
        stdout = self._process.stdout
        assert stdout is not None
        if not select.select([stdout], [], [], timeout)[0]:
            self.close()
            raise RuntimeError('%r writes nothing for %g s' % (self._process.args, timeout))
        line = str(stdout.readline())
        if not line:
            raise RuntimeError('%r ended with %s' % (self._process.args, self._process.wait()))
        return line.strip()

    def ask(self, words: str, timeout: float = 60.0) -> str:
        """Write a line and return the answer.

        :param timeout: [s]
        :raises RuntimeError: where none comes
        """
        stdin = self._process.stdin
        assert stdin is not None
        stdin.write(words + '\n')
        stdin.flush()
        return self.line(timeout)

    def close(self) -> None:
        """Close its stdin and end it."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        end(self._process)


class Master:
    """A ROS master on a free port, for this process and its children; a context manager."""

    def __enter__(self) -> 'Master':
        port = free_port()
        uri = 'http://127.0.0.1:%d' % port
        self._logs = tempfile.mkdtemp()
        os.environ.pop('ROS_HOSTNAME', None)    # it would take precedence over ROS_IP
        os.environ.update(ROS_MASTER_URI=uri, ROS_IP='127.0.0.1', ROS_LOG_DIR=self._logs)
        self._process = start(['rosmaster', '--core', '-p', str(port)])
        while True:
            try:
                xmlrpc.client.ServerProxy(uri).getUri('/bench')
                return self
            except OSError:
                time.sleep(0.05)

    def __exit__(self, *_: Any) -> None:
        end(self._process)
        shutil.rmtree(self._logs, ignore_errors=True)
