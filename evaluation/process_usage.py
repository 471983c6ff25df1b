# SPDX-License-Identifier: BSD-3-Clause
"""Threads, file descriptors and resident memory of a node, in whatever network namespace it runs."""
import contextlib
import os
import pathlib
import socket
from typing import Callable, Collection, Dict, FrozenSet, NamedTuple, Optional, Sequence, Tuple

import psutil

from .soak import Usage

ESTABLISHED, CLOSE_WAIT = '01', '08'
"""States of a connection in /proc/PID/net/tcp, see proc(5); of the latter the other side has ended."""

LOCAL, REMOTE = 1, 2
"""Columns of the addresses there."""

MAX_IDLE = 3
"""Connections that do not count: to the master, one of the watch and one of rospy's own calls; and those that the other
side has ended, as rosout's is with the master. rospy notices, and makes another one, only when it next sends."""


SHARED = 'pipe:', '/memfd:'
"""What a process shares with a living child does not count: a decoder of video begins with the first video."""


Endpoint = Tuple[str, int]
"""Address and port."""


class Resources(NamedTuple):
    """What a process has at one moment."""
    threads: FrozenSet[int]
    descriptors: FrozenSet[str]
    """Number and target of each; sockets have numbers of their own."""
    clients: FrozenSet[str]
    """Those of established connections to its server. rosmaster keeps one open, once it had to notify the node; rospy
    serves it by a thread."""
    idle: FrozenSet[str]
    """Those of connections to the master, and of connections that the other side has ended."""
    stranded: FrozenSet[str]
    """Those of established connections to an address that no machine has any more. Nobody can end them but rospy's
    keep-alive, after 150 s; each has a thread."""
    memory: float
    """Resident [MB]."""


def resources(process: int, port: Optional[int], master: Optional[int] = None, gone: Collection[str] = ()
              ) -> Resources:
    """What a process has now.

    :param port: of its XML-RPC server; None: not known
    :param master: port of the master; None: not known
    :param gone: addresses that no machine has any more
    :raises OSError, psutil.Error: if the process has ended
    """
    folder, running = pathlib.Path('/proc/%d' % process), psutil.Process(process)
    children = {target for child in running.children() for target in _targets(child.pid).values()}
    targets = {'%s %s' % (name, target): target for name, target in _targets(process).items()
               if not (target.startswith(SHARED) and target in children)}
    rows = [line.split() for line in (folder / 'net' / 'tcp').read_text().splitlines()[1:]]

    def those(wanted: Callable[[str, Endpoint, Endpoint], bool]) -> FrozenSet[str]:
        """The connections of a state, a local and a remote endpoint that are wanted."""
        found = {'socket:[%s]' % row[9] for row in rows
                 if wanted(row[3], _endpoint(row[LOCAL]), _endpoint(row[REMOTE]))}
        return frozenset(name for name, target in targets.items() if target in found)

    return Resources(
        frozenset(thread.id for thread in running.threads()), frozenset(targets),
        those(lambda state, local, _: state == ESTABLISHED and local[1] == port),
        those(lambda state, _, remote: state == CLOSE_WAIT or remote[1] == master),
        those(lambda state, _, remote: state == ESTABLISHED and remote[0] in gone), running.memory_info().rss / 1e6)


def _endpoint(column: str) -> Endpoint:
    """An endpoint as /proc/PID/net/tcp has it, on a little-endian machine."""
    address, port = column.split(':')
    return socket.inet_ntoa(int(address, 16).to_bytes(4, 'little')), int(port, 16)


def _targets(process: int) -> Dict[str, str]:
    """{number of a descriptor: what it refers to}; empty if the process has ended, or is a zombie."""
    found = {}
    with contextlib.suppress(OSError):
        for descriptor in pathlib.Path('/proc/%d/fd' % process).iterdir():
            with contextlib.suppress(FileNotFoundError):    # closed meanwhile
                found[descriptor.name] = os.readlink(str(descriptor))
    return found


def lasting(samples: Sequence[Resources]) -> Usage:
    """What a process had in all of some samples. Threads and connections that come and go do not count, though there
    may be one at any time; nor do those that clients keep open, stranded ones, and MAX_IDLE idle ones.

    :param samples: one at least
    """
    threads, descriptors, clients, idle, stranded = (
        frozenset.intersection(*(getattr(sample, what) for sample in samples))
        for what in ('threads', 'descriptors', 'clients', 'idle', 'stranded'))
    others = len(clients | stranded)
    return Usage(len(threads) - others, len(descriptors) - others - min(MAX_IDLE, len(idle - clients - stranded)),
                 min(sample.memory for sample in samples))
