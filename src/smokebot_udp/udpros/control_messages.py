# SPDX-License-Identifier: BSD-3-Clause
"""Control messages of datagrams (cmsg(3)): when they came, by which interface, and what networks marked."""
import socket
import struct
from typing import Dict, List, NamedTuple, Optional, Tuple, Union

import numpy as np

from .. import traffic
from ..arrays import BoolArray, DType, IntArray, Records, UInt8Array

IP_PKTINFO = 8              # linux/in.h: a control message says by which interface
IP_RECVTOS = 13             # linux/in.h: a control message holds the second byte of the IP header
SO_TIMESTAMPNS = 35         # asm-generic/socket.h: a control message holds the time of arrival

SIZE_T = np.dtype(np.uintp)

_HEADER = [('length', np.uintp), ('level', '=i4'), ('type', '=i4')]

TIMESTAMP: DType = np.dtype([*_HEADER, ('seconds', np.int_), ('nanoseconds', np.int_)])
"""A control message with a struct timespec."""

PKTINFO: DType = np.dtype([*_HEADER, ('interface', '=u4'), ('local', '>u4'), ('to', '>u4')], align=True)
"""A control message with a struct in_pktinfo: the interface's index, the address to which answers come, and that to
which the datagram went."""

TOS: DType = np.dtype([*_HEADER, ('value', np.uint8, (SIZE_T.itemsize,))])
"""A control message with the second byte of the IP header, the first one of its `value`."""

CONTROLS = ((socket.SOL_SOCKET, SO_TIMESTAMPNS, SO_TIMESTAMPNS, TIMESTAMP),
            (socket.IPPROTO_IP, IP_PKTINFO, IP_PKTINFO, PKTINFO), (socket.IPPROTO_IP, IP_RECVTOS, socket.IP_TOS, TOS))
"""Level, option, type and layout of the control messages asked for, in the order in which the kernel adds them."""

CONTROL_SIZE = sum(layout.itemsize for _, _, _, layout in CONTROLS)
"""The size of all of them [byte]."""

LOOPBACK_INTERFACE = 1
"""Its index on each Linux. What comes by it came from this machine, by the kernel's routes."""


class Via(NamedTuple):
    """How a datagram leaves this machine."""
    interface: int = 0
    """Index of the interface; 0: as the kernel's routes say."""
    source: int = 0
    """IPv4 address from which it leaves; 0: the kernel's choice."""


KERNELS = Via()
"""As the kernel's routes say."""

Control = Tuple[int, int, bytes]
"""A control message of sendmsg: level, type, data."""


def controls_of(via: Via) -> List[Control]:
    """The control messages of sendmsg by which a datagram leaves so."""
    if via == KERNELS:
        return []
    info = struct.pack('=I', via.interface) + struct.pack('!II', via.source, 0)
    return [(socket.IPPROTO_IP, IP_PKTINFO, info)]


class ControlMessages:
    """Those of a batch that recvmmsg has received.

    :param sock: which is asked for them from now on
    :param room: (batch, CONTROL_SIZE) uint8, to which the kernel writes them
    :param lengths: (batch,) bytes that the kernel has written of each row
    """

    def __init__(self, sock: socket.socket, room: UInt8Array, lengths: IntArray) -> None:
        self._room, self._lengths = room, lengths       # the kernel writes there
        self._records: Dict[int, Tuple[int, int, Records]] = {}     # {type: (level, where it ends, in each row)}
        offset = 0
        for level, option, kind, layout in CONTROLS:
            try:
                sock.setsockopt(level, option, 1)
            except OSError:     # a sandbox
                continue
            records: Records = np.ndarray((len(room),), layout, room, offset, room.strides[:1])
            offset += layout.itemsize
            self._records[kind] = level, offset, records

    def clear(self) -> None:
        """Let the kernel write all rows."""
        self._lengths[:] = CONTROL_SIZE

    def arrived(self, row: int) -> Optional[float]:
        """When a row's datagram reached this machine, by time.time() [s]; None: the kernel does not say."""
        if SO_TIMESTAMPNS not in self._records or self._lengths[row] < TIMESTAMP.itemsize:
            return None
        _, _, kind, seconds, nanoseconds = self._records[SO_TIMESTAMPNS][2][row].item()
        return float(seconds + 1e-9 * nanoseconds) if kind == SO_TIMESTAMPNS else None

    def say_how(self, sources: Records) -> None:
        """Fill in `interface` and `local` of the first rows' senders, as endpoints.SOCKADDR_IN has them."""
        if IP_PKTINFO in self._records:
            rows = slice(len(sources))
            has, records = self._have(IP_PKTINFO, rows), self._records[IP_PKTINFO][2][rows]
            sources['local'] = has * records['local']
            sources['interface'] = has * (records['interface'] != LOOPBACK_INTERFACE) * records['interface']

    def marked(self, rows: IntArray) -> int:
        """How many of some rows' datagrams a congested queue has marked (ECN)."""
        if socket.IP_TOS not in self._records:
            return 0
        rows = rows[self._records[socket.IP_TOS][2]['value'][rows, 0] & traffic.ECN == traffic.CE]
        return int(np.count_nonzero(self._have(socket.IP_TOS, rows))) if len(rows) else 0

    def _have(self, kind: int, rows: Union[IntArray, slice]) -> BoolArray:
        """Which rows have a message of a type."""
        level, end, records = self._records[kind]
        has: BoolArray = ((self._lengths[rows] >= end) & (records['level'][rows] == level)
                          & (records['type'][rows] == kind))
        return has
