# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a benchmark: a master of its own, and peers that obey lines on stdin. None outlives it."""
import ctypes
import os
import select
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import xmlrpc.client

PR_SET_PDEATHSIG = 1    # linux/prctl.h: the signal that a process gets when its parent ends

PATIENCE = 5.0
"""So long a process may take to end when it is asked to [s]."""

_libc = ctypes.CDLL(None)


def start(command, **options):
    """A process that ends with this one, however this one ends; it says nothing unless stdout is given."""
    return subprocess.Popen(command, **{'stdin': subprocess.DEVNULL, 'stdout': subprocess.DEVNULL,
                                        'stderr': subprocess.DEVNULL, **options},
                            preexec_fn=lambda: _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM))


def end(*processes):
    """End processes together, the hard way those that do not obey."""
    for process in processes:
        process.terminate()
    for process in processes:
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


class Peer:
    """One end, in a process of its own."""

    def __init__(self, command):
        self._process = start(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, universal_newlines=True,
                              bufsize=1)
        self.pid = self._process.pid

    def line(self, patience=60.0):
        if not select.select([self._process.stdout], [], [], patience)[0]:
            self.close()
            raise RuntimeError('%s says nothing for %g s' % (self._process.args, patience))
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError('%s ended with %s' % (self._process.args[:3], self._process.wait()))
        return line.strip()

    def ask(self, words):
        self._process.stdin.write(words + '\n')
        self._process.stdin.flush()
        return self.line()

    def close(self):
        self._process.stdin.close()
        end(self._process)


class Master:
    """A roscore for the benchmark alone."""

    def __enter__(self):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            port = probe.getsockname()[1]
        os.environ.pop('ROS_HOSTNAME', None)    # it would count more than ROS_IP
        os.environ.update(ROS_MASTER_URI='http://127.0.0.1:%d' % port, ROS_IP='127.0.0.1')
        self._logs = tempfile.mkdtemp()
        os.environ['ROS_LOG_DIR'] = self._logs
        self._process = start(['rosmaster', '--core', '-p', str(port)])
        while True:
            try:
                xmlrpc.client.ServerProxy(os.environ['ROS_MASTER_URI']).getUri('/bench')
                return self
            except OSError:
                time.sleep(0.05)

    def __exit__(self, *_):
        end(self._process)
        shutil.rmtree(self._logs, ignore_errors=True)
