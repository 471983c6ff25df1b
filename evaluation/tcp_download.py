# SPDX-License-Identifier: BSD-3-Clause
"""A TCP download over the link lab, beside what is measured: the robot's side sends as much as it can.

    python3 -m evaluation.tcp_download send CONGESTION_CONTROL      prints its port, and the algorithm of the connection
    python3 -m evaluation.tcp_download receive HOST PORT
"""
import contextlib
import socket
import subprocess
import sys
from typing import Iterator

from smokebot_udp.link_lab.lab import ADDRESSES

from . import TOP
from .stack import Stack

BLOCK = bytes(1 << 16)
"""Data that are handed to the socket at a time."""

NAME_SIZE = 16
"""Maximum length of the name of a congestion control algorithm in Linux (TCP_CA_NAME_MAX) [byte]."""


@contextlib.contextmanager
def download(stack: Stack, congestion_control: str) -> Iterator[None]:
    """Download from the robot's side to the operator's while this lasts.

    :param congestion_control: of this connection: cubic, bbr, ...
    :raises RuntimeError: where it has another one
    """
    command = sys.executable, '-m', 'evaluation.tcp_download'
    sender = stack.start('robot', *command, 'send', congestion_control, cwd=str(TOP), stdout=subprocess.PIPE,
                         universal_newlines=True)
    assert sender.stdout is not None
    port = sender.stdout.readline().strip()
    receiver = stack.start('operator', *command, 'receive', ADDRESSES['robot'], port, cwd=str(TOP))
    try:
        found = sender.stdout.readline().strip()
        if found != congestion_control:
            raise RuntimeError('the download has %r, not %s: see nodes.log' % (found, congestion_control))
        yield
    finally:
        stack.end(receiver)
        stack.end(sender)


def send(congestion_control: str) -> None:
    """Send zeros to the first one that connects, until it leaves."""
    with socket.create_server(('', 0)) as server:
        print(server.getsockname()[1], flush=True)
        connection, _ = server.accept()
    with connection:
        # not before: the algorithm of the lab's route would replace it
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, congestion_control.encode())
        name = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, NAME_SIZE)
        print(name.rstrip(b'\0').decode(), flush=True)
        with contextlib.suppress(ConnectionError):
            while True:
                connection.sendall(BLOCK)


def receive(host: str, port: int) -> None:
    """Take everything, until the sender leaves."""
    with socket.create_connection((host, port)) as connection:
        while connection.recv(len(BLOCK)):
            pass


if __name__ == '__main__':
    if sys.argv[1] == 'send':
        send(sys.argv[2])
    else:
        receive(sys.argv[2], int(sys.argv[3]))
