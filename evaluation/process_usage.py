# SPDX-License-Identifier: BSD-3-Clause
"""Threads, file descriptors and resident memory of a node, in whatever network namespace it runs."""
import contextlib
import os
import pathlib
from typing import Optional

import psutil

from .soak import Usage

ESTABLISHED = '01'
"""State of a connection in /proc/PID/net/tcp, see proc(5)."""

ATTEMPTS = 5
"""How often a process is looked at where connections come and go meanwhile."""


def kept_open(process: int, port: int) -> int:
    """The number of TCP connections to a port of a process that its clients keep open.

    :raises OSError: if the process has ended
    """
    folder = pathlib.Path('/proc/%d' % process)
    sockets = set()
    for descriptor in (folder / 'fd').iterdir():
        with contextlib.suppress(FileNotFoundError):    # closed meanwhile
            sockets.add(os.readlink(str(descriptor)))
    rows = [line.split() for line in (folder / 'net' / 'tcp').read_text().splitlines()[1:]]
    # a set: the kernel may list one twice, or miss one, where others come and go meanwhile
    kept = {'socket:[%s]' % row[9] for row in rows
            if row[3] == ESTABLISHED and int(row[1].split(':')[1], 16) == port}
    return len(kept & sockets)


def usage(process: int, port: Optional[int]) -> Usage:
    """The resources of a process.

    rosmaster keeps a connection to each node's XML-RPC server open, once it had to notify it; rospy serves it by a
    thread. Such threads and descriptors are not counted: they come and go with the client's decision.

    :param port: of its XML-RPC server; None: not known
    :raises OSError, psutil.Error: if the process has ended
    """
    running = psutil.Process(process)
    for _ in range(ATTEMPTS):
        clients = 0 if port is None else kept_open(process, port)
        found = Usage(running.num_threads() - clients, running.num_fds() - clients, running.memory_info().rss / 1e6)
        if port is None or kept_open(process, port) == clients:     # else one came or went meanwhile
            break
    return found
