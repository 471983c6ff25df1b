# SPDX-License-Identifier: BSD-3-Clause
"""UDP datagrams whose source is anybody's address: what a stranger on the same network can send. Needs root."""
import contextlib
import socket
import struct
from typing import Tuple

Address = Tuple[str, int]
"""Numeric IPv4 address, and port."""


def packet(source: Address, to: Address, payload: bytes) -> bytes:
    """An IP packet with a UDP datagram (RFC 791, RFC 768).

    The kernel adds its length and checksum, the datagram's checksum is left out.
    """
    addresses = [socket.inet_aton(host) for host, _ in (source, to)]
    ip = struct.pack('!BBHHHBBH4s4s', 0x45, 0, 0, 0, 0, 64, socket.IPPROTO_UDP, 0, *addresses)
    return ip + struct.pack('!HHHH', source[1], to[1], 8 + len(payload), 0) + payload


class Forger(contextlib.ExitStack):
    """Sends forged datagrams; a context manager.

    :raises PermissionError: if this process may not
    """

    def __init__(self) -> None:
        super().__init__()
        self._raw = self.enter_context(socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW))

    def send(self, source: Address, to: Address, payload: bytes) -> None:
        """Send one.

        :raises OSError: where it cannot leave
        """
        self._raw.sendto(packet(source, to, payload), (to[0], 0))
