# SPDX-License-Identifier: BSD-3-Clause
"""A tap on a side's end of the emulated link: which of a port's datagrams passes, and when.

    python3 -m evaluation.tap PORT

It writes a JSON line [time [s], source port, kind, size [byte]] for each datagram from or to the port that is not DATA:
handshakes, in the first place. Tap is its reader.
"""
import ctypes
import json
import math
import socket
import struct
import subprocess
import sys
import threading
import time
from typing import Any, Iterator, List, NamedTuple, Optional, Tuple

from smokebot_udp.link.packets import Kind
from smokebot_udp.link_lab.lab import DEVICE

from . import TOP
from .stack import Stack

ETH_P_ALL = 3           # linux/if_ether.h
SO_TIMESTAMPNS = 35     # asm-generic/socket.h: a control message holds the time of arrival
TIMESPEC = struct.Struct('@2l')
SO_ATTACH_FILTER = 26   # asm-generic/socket.h
INSTRUCTION = struct.Struct('@HBBI')
"""Format of an instruction of a packet filter (linux/filter.h): code, jump if true, jump if false, constant."""

ONLY_UDP = (0x30, 0, 0, 9), (0x15, 0, 1, socket.IPPROTO_UDP), (0x06, 0, 0, 0xffff), (0x06, 0, 0, 0)
"""Packet filter: load the protocol's byte of the IP header; if it is UDP, keep the packet, else drop it."""

LOOPBACK = 'lo'
RECEIVE_BUFFER = 1 << 22
"""Size of the socket's receive buffer [byte]."""

PORTS = struct.Struct('!HH')
DO_NOT_FRAGMENT = b'\x40\0'


class Datagram(NamedTuple):
    """A UDP datagram on the link."""
    time: float
    """When the device took it, by time.time() [s]."""
    source: Tuple[str, int]
    to: Tuple[str, int]
    payload: bytes


class Seen(NamedTuple):
    """A datagram that Tap reports."""
    time: float
    """[s]"""
    port: int
    """Port of the datagram's source."""
    kind: int
    size: int
    """[byte]"""


def open_tap(device: str = DEVICE) -> socket.socket:
    """A socket that takes all UDP packets of a device on this side, the link's by default."""
    tap = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, 0)
    tap.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    tap.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
    code = ctypes.create_string_buffer(b''.join(INSTRUCTION.pack(*one) for one in ONLY_UDP))
    tap.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, struct.pack('@HP', len(ONLY_UDP), ctypes.addressof(code)))
    tap.bind((device, ETH_P_ALL))
    return tap


def datagrams(tap: socket.socket, port: int, timeout: float = math.inf) -> Iterator[Datagram]:
    """The datagrams from or to a port, each once, until none passes for the timeout [s]."""
    last = time.monotonic()
    while True:
        left = last + timeout - time.monotonic()
        if left <= 0:
            return
        tap.settimeout(None if left == math.inf else left)
        try:
            packet, control, _, (device, _, kind, *_) = tap.recvmsg(65536, 64)
        except socket.timeout:
            return
        found = parse(packet, arrival(control))
        twice = device == LOOPBACK and kind == socket.PACKET_OUTGOING      # it is seen as it arrives, too
        if found is not None and port in (found.source[1], found.to[1]) and not twice:
            last = time.monotonic()
            yield found


def arrival(control: List[Tuple[int, int, bytes]]) -> float:
    """The time of a packet, of its control messages (time.time())."""
    for level, kind, data in control:
        if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS):
            seconds, nanoseconds = TIMESPEC.unpack(data[:TIMESPEC.size])
            return float(seconds + 1e-9 * nanoseconds)
    return time.time()


def parse(packet: bytes, now: float) -> Optional[Datagram]:
    """The UDP datagram in an IPv4 packet; None: it is another packet, or a fragment (RFC 791, RFC 768)."""
    head = 4 * (packet[0] & 15) if packet else 0
    fragment = packet[6:8] not in (b'\0\0', DO_NOT_FRAGMENT)
    if len(packet) < head + 8 or packet[0] >> 4 != 4 or packet[9] != socket.IPPROTO_UDP or fragment:
        return None
    ports = PORTS.unpack_from(packet, head)
    hosts = [socket.inet_ntoa(packet[at:at + 4]) for at in (12, 16)]
    return Datagram(now, (hosts[0], ports[0]), (hosts[1], ports[1]), packet[head + 8:])


class Tap:
    """What the tap on a side reports.

    :param stack: the program becomes a part of it
    """

    def __init__(self, stack: Stack, port: int, side: str = 'operator') -> None:
        self.seen: List[Seen] = []
        self._more = threading.Condition()
        process = stack.start(side, sys.executable, '-m', __name__, str(port), cwd=str(TOP), stdout=subprocess.PIPE,
                              universal_newlines=True)
        assert process.stdout is not None
        self._lines = process.stdout
        if not self._lines.readline():
            raise RuntimeError('the tap ended with exit code %r' % process.wait())
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._lines:
            with self._more:
                self.seen.append(Seen(*json.loads(line)))
                self._more.notify_all()

    def first(self, kind: int, since: float, timeout: float = 30.0) -> Seen:
        """The first datagram of a kind since a time.

        :param since: time.time()
        :param timeout: [s]
        :raises RuntimeError: where none passes
        """
        def found() -> Optional[Seen]:
            return next((seen for seen in self.seen if seen.kind == kind and seen.time >= since), None)
        with self._more:
            seen = self._more.wait_for(found, timeout)
        if seen is None:
            raise RuntimeError('no datagram of kind %d passes' % kind)
        return seen


def main(port: int) -> None:
    """Report until the process is killed."""
    tap = open_tap()
    write(None)
    for datagram in datagrams(tap, port):
        kind = datagram.payload[0] if datagram.payload else -1
        if kind != Kind.DATA:
            write([datagram.time, datagram.source[1], kind, len(datagram.payload)])


def write(value: Any) -> None:
    """Write a line of JSON at once."""
    print(json.dumps(value), flush=True)


if __name__ == '__main__':
    main(int(sys.argv[1]))
