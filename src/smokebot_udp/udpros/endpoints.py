# SPDX-License-Identifier: BSD-3-Clause
"""The sockets of UDPROS, which send (UDP GSO) and receive (recvmmsg) batches of datagrams.

Linux only, as rospy's own use of sockets. If the kernel or the C library lacks one of the calls, plain send and
recvfrom_into replace it, more slowly. IPv4 only, as roscpp's UDPROS.
"""
import collections
import contextlib
import ctypes
import errno
import math
import mmap
import select
import socket
import struct
import threading
import time
from typing import Any, Counter, Optional, Sequence, Set, Tuple, Union

import numpy as np

from .. import traffic
from ..arrays import Array, DType, IntArray, Records, UInt8Array
from .control_messages import CONTROL_SIZE, KERNELS, Control, ControlMessages, Via, controls_of
from .datagram import IP_UDP_HEADERS, UDP_MAX_PAYLOAD, Buffer

UDP_SEGMENT = 103           # linux/udp.h: cut the data into datagrams of this size
MAX_SEGMENTS = 64           # linux/udp.h: UDP_MAX_SEGMENTS of the oldest kernels that have it
SO_RCVBUFFORCE = 33         # asm-generic/socket.h: beyond rmem_max, for privileged processes
SO_MEMINFO = 55             # asm-generic/socket.h: the socket's memory statistics, with the drops at this index:
MEMINFO_DROPS = 8           # linux/sock_diag.h: SK_MEMINFO_DROPS
SO_PRIORITY = 12            # asm-generic/socket.h: of datagrams in this machine's queues
IP_MTU = 14                 # linux/in.h: the path MTU of a connected socket
MAP_POPULATE = 0x8000       # asm-generic/mman.h, and x86; Python 3.8 does not name it

SEND_TIMEOUT = 0.05
"""How long a call waits for room in the socket before it drops the rest [s]."""

NO_GSO = (errno.EINVAL, errno.EIO, errno.EMSGSIZE, errno.ENOPROTOOPT, errno.EOPNOTSUPP)
"""GSO is not available on this kernel or device, or the datagrams exceed the path MTU; plain sends are fragmented
instead."""

GSO_RETRY = 5.0
"""Datagrams that are as long are sent one by one for this time: then the path may have changed [s]."""

PLAIN_PERIOD = 5.0
"""With GSO datagrams leave without the bit DF, and no router says that they are too long: it cuts them. So each
PLAIN_PERIOD one burst is sent one by one, from which the kernel learns the path MTU [s]."""

MAX_QUEUEING = 1.0
"""A datagram that seems to have waited longer in this machine did not: the clock was set [s]."""

MAX_POPULATED = 1 << 20
"""Shorter receive slots get their memory at once, so that a rare long burst does not need any [byte]."""

READING_ERROR = 1e-5
"""Error of reading a clock, its resolution included [s]."""

SOCKADDR_IN: DType = np.dtype([('family', '=u2'), ('port', '>u2'), ('address', '>u4'), ('interface', '=u4'),
                               ('local', '>u4')])
"""With the first fields of PKTINFO in place of its zeros."""

LOOPBACK = 0x7f000000, 0xff000000
"""127.0.0.0/8: network and mask."""

Address = Tuple[str, int]
"""Host and port."""


class PeerGone(Exception):
    """The peer's host reports that the port is closed (ICMP port unreachable)."""


class _NoGso(Exception):
    """The kernel does not send many datagrams in one call now: they are sent one by one."""


def interface_name(index: int) -> str:
    """The name of an interface; empty: there is none, or index is 0."""
    try:
        return socket.if_indextoname(index) if index else ''
    except OSError:
        return ''


def path_payload(host: str, port: int, via: Via = KERNELS) -> int:
    """The longest UDP payload that reaches the host unfragmented, as far as the kernel knows [byte].

    :raises OSError: if the host is unknown or unreachable
    :raises UnicodeError: if it is not a host name
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        if via.interface:
            with contextlib.suppress(OSError):      # before Linux 5.7 for privileged processes only
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface_name(via.interface).encode())
        probe.connect((host, port))
        return min(UDP_MAX_PAYLOAD, probe.getsockopt(socket.IPPROTO_IP, IP_MTU) - IP_UDP_HEADERS)


class _Tos:
    """The second byte of the IP headers of what a socket sends, see traffic.py.

    A control message could say it for one call, but not the priority of that call.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        """Held while `set` and the call are made."""
        self._last = 0

    def set(self, sock: socket.socket, tos: int) -> None:
        if tos != self._last:
            self._last = tos
            with contextlib.suppress(OSError):      # a sandbox: all arrives without it
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, tos)
                sock.setsockopt(socket.SOL_SOCKET, SO_PRIORITY, traffic.priority(tos))


class BatchSender:
    """Sends batches of datagrams from a socket. No call blocks longer than SEND_TIMEOUT, whatever the peer does.

    :param sock: non-blocking; whoever made it closes it
    :param gso: whether to send many datagrams in one call
    """

    def __init__(self, sock: socket.socket, gso: bool = True) -> None:
        self.socket = sock
        self.tos = 0
        """Second byte of the IP headers of what is sent from now on, see traffic.py."""
        self._shared = _Tos()
        self.failures: Counter[str] = collections.Counter()
        """Datagrams that could not be sent, by the error's name. EPERM: a local firewall; EAGAIN: the network device is
        too slow; ENETUNREACH, EHOSTUNREACH: no route, such as a pulled cable."""
        self._gso = gso
        self._refused_size, self._refused_until = 0, 0.0    # of datagrams for which the kernel refused GSO
        self._plain_due = time.monotonic() + PLAIN_PERIOD
        self._poll = select.poll()
        self._poll.register(sock, select.POLLOUT)

    def another(self, tos: int) -> 'BatchSender':
        """A sender of the same socket, with a `tos` and counts of its own."""
        other = BatchSender(self.socket, self._gso)
        other.tos, other._shared = tos, self._shared
        return other

    @property
    def gso(self) -> bool:
        """Whether GSO is in use, and was not refused lately."""
        return self._gso and time.monotonic() > self._refused_until

    def send_one(self, *parts: Union[Buffer, UInt8Array], to: Optional[Address] = None, via: Via = KERNELS) -> int:
        """Send one datagram, given in parts.

        :param to: numeric IPv4 address and port; None: the socket is connected
        :param via: by which interface; where it is gone, nothing is sent
        :return: how many datagrams were sent, 1 or 0
        :raises PeerGone: if the socket is connected, and the peer closed its port
        """
        return self._try_to_send(parts, controls_of(via), 1, time.monotonic() + SEND_TIMEOUT, to)

    def send(self, datagrams: Union[Buffer, UInt8Array], size: int, count: int, to: Optional[Address] = None,
             via: Via = KERNELS) -> int:
        """Send many datagrams.

        :param datagrams: C-contiguous, one after the other; each is `size` bytes long, the last one may be shorter
        :param to: as of `send_one`, as is `via`
        :return: how many datagrams were sent
        :raises PeerGone: as `send_one`
        """
        data: Any = datagrams
        view, sent = memoryview(data).cast('B'), 0
        deadline, controls = time.monotonic() + SEND_TIMEOUT, controls_of(via)
        burst = size * min(MAX_SEGMENTS, UDP_MAX_PAYLOAD // size)
        for start in range(0, count * size, burst):
            sent += self._send_burst(view[start:start + burst], size, controls, deadline, to)
        return sent

    def _send_burst(self, datagrams: memoryview, size: int, controls: Sequence[Control], deadline: float,
                    to: Optional[Address]) -> int:
        """Send at most MAX_SEGMENTS datagrams."""
        if len(datagrams) > size and deadline > self._plain_due:
            self._plain_due = deadline + PLAIN_PERIOD
        elif len(datagrams) > size and self._gso and (size < self._refused_size or deadline > self._refused_until):
            segment = socket.IPPROTO_UDP, UDP_SEGMENT, struct.pack('=H', size)
            try:
                return self._try_to_send((datagrams,), [segment, *controls], -(-len(datagrams) // size), deadline, to)
            except _NoGso:
                self._refused_size, self._refused_until = size, deadline + GSO_RETRY
        return sum(self._try_to_send((datagrams[start:start + size],), controls, 1, deadline, to)
                   for start in range(0, len(datagrams), size))

    def _try_to_send(self, parts: Sequence[Any], controls: Sequence[Control], count: int, deadline: float,
                     to: Optional[Address]) -> int:
        """One sendmsg call with `count` datagrams; returns how many were sent: all, or none.

        :raises _NoGso: if there are several, and the kernel refuses the control message that asks for GSO
        """
        while True:
            try:
                with self._shared.lock:
                    self._shared.set(self.socket, self.tos)
                    self.socket.sendmsg(parts, controls, 0, to)
                return count
            except ConnectionRefusedError as error:
                raise PeerGone('the port of %s:%d is closed' % self.socket.getpeername()) from error
            except BlockingIOError:
                left = deadline - time.monotonic()
                if left > 0 and self._poll.poll(left * 1e3):
                    continue
                self.failures['EAGAIN'] += count
                return 0
            except OSError as error:
                if count > 1 and error.errno in NO_GSO:
                    raise _NoGso from error
                if error.errno == errno.EBADF:
                    raise
                self.failures[errno.errorcode.get(error.errno or 0, str(error.errno))] += count
                return 0


class DatagramSender(BatchSender):
    """Sends datagrams to one peer from a socket of its own.

    :param gso: whether to send many datagrams in one call
    :raises OSError: if the host is unknown or unreachable
    :raises UnicodeError: if it is not a host name
    """

    def __init__(self, host: str, port: int, gso: bool = True) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setblocking(False)
            sock.connect((host, port))
            self.local: Address = sock.getsockname()
            self.remote: Address = sock.getpeername()
            super().__init__(sock, gso)
        except OSError:
            sock.close()
            raise

    def close(self) -> None:
        """Free the socket; sending then raises OSError."""
        self.socket.close()


class _MsgHdr(ctypes.Structure):
    _fields_ = [('name', ctypes.c_void_p), ('namelen', ctypes.c_uint32), ('iov', ctypes.c_void_p),
                ('iovlen', ctypes.c_size_t), ('control', ctypes.c_void_p), ('controllen', ctypes.c_size_t),
                ('flags', ctypes.c_int)]


class _MMsgHdr(ctypes.Structure):
    _fields_ = [('hdr', _MsgHdr), ('len', ctypes.c_uint)]


class ClockOffset:
    """The machine's clock (time.time) minus the steady clock (time.monotonic).

    It is the same for as long as the machine's clock is not set: then times of the one clock keep their order in the
    other one, and a thread that is interrupted between both readings does no harm.
    """

    def __init__(self) -> None:
        self._value = math.nan

    def __call__(self) -> float:
        """The offset [s]; any thread."""
        least, most = self._bounds()
        if not least <= self._value <= most:
            least, most = min((self._bounds() for _ in range(5)), key=lambda bounds: bounds[1] - bounds[0])
            self._value = (least + most) / 2
        return self._value

    @staticmethod
    def _bounds() -> Tuple[float, float]:
        """Between which the offset is now [s]."""
        before, wall, after = time.monotonic(), time.time(), time.monotonic()
        return wall - after - READING_ERROR, wall - before + READING_ERROR


class DatagramReceiver:
    """One bound UDP socket and a batch of receive slots.

    After `receive` returned n, rows [0, n) of `datagrams`, `lengths` and `sources` describe the datagrams received,
    until the next call.

    :param address: the local IPv4 address to bind
    :param max_datagram_size: the longest datagram to receive whole [byte of UDP payload]
    :param receive_buffer: size to request from the kernel [byte]
    :param batch: maximum number of datagrams per call
    :param recvmmsg: whether to receive many datagrams in one call, if the C library can
    :param port: the local port to bind; 0: any free one
    :raises OSError: if this machine does not have the address, or the port is in use
    """

    def __init__(self, address: str, max_datagram_size: int, receive_buffer: int = 4 << 20, batch: int = 512,
                 recvmmsg: bool = True, port: int = 0) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.setblocking(False)
            self.receive_buffer = _grow_receive_buffer(self.socket, receive_buffer)
            """Size granted by the kernel, which includes its own overhead [byte]."""
            self.socket.bind((address, port))
        except OSError:
            self.socket.close()
            raise
        self.address: Address = self.socket.getsockname()
        """The local address and port."""
        self.max_datagram_size = max_datagram_size
        # one more byte reveals a datagram that is too long
        self.datagrams: UInt8Array = _mapped((batch, max_datagram_size + 1), np.uint8)
        """(batch, max_datagram_size + 1) uint8."""
        self.lengths: IntArray = _mapped((batch,), np.int64)
        """(batch,) int64; max_datagram_size + 1 if the datagram is longer than max_datagram_size [byte]."""
        self.sources: Records = _mapped((batch,), SOCKADDR_IN)
        """(batch,) of SOCKADDR_IN: the senders."""
        self.batch = batch
        self._offset = ClockOffset()
        self._poll = select.poll()
        self._poll.register(self.socket, select.POLLIN)
        self._controls: Optional[ControlMessages] = None
        self._recvmmsg = _find_recvmmsg() if recvmmsg else None
        if self._recvmmsg:
            self._prepare()

    @property
    def recvmmsg(self) -> bool:
        """Whether recvmmsg is in use; otherwise datagrams have no time of arrival, and no marks."""
        return self._recvmmsg is not None

    def _prepare(self) -> None:
        """Let the kernel's headers point to the rows of our arrays."""
        self._headers = _mapped((self.batch,), _MMsgHdr)
        self._iovecs = _mapped((self.batch, 2), np.uintp)
        self._iovecs[:, 0] = self.datagrams.ctypes.data + self.datagrams.strides[0] * np.arange(self.batch)
        self._iovecs[:, 1] = self.datagrams.shape[1]
        header = self._headers['hdr']
        header['name'] = self.sources.ctypes.data + SOCKADDR_IN.itemsize * np.arange(self.batch)
        header['namelen'] = SOCKADDR_IN.itemsize
        header['iov'] = self._iovecs.ctypes.data + self._iovecs.strides[0] * np.arange(self.batch)
        header['iovlen'] = 1
        self._lengths = self._headers['len']
        room = _mapped((self.batch, CONTROL_SIZE), np.uint8)
        header['control'] = room.ctypes.data + room.strides[0] * np.arange(self.batch)
        self._controls = ControlMessages(self.socket, room, header['controllen'])

    def wait(self, timeout: float) -> bool:
        """Wait until there is something to receive (or an error to clear); False after timeout [s]."""
        return bool(self._poll.poll(timeout * 1e3))

    def receive(self) -> int:
        """Receive without waiting; returns the number of datagrams, at most `batch`.

        :raises OSError: if the socket fails
        """
        if self._recvmmsg is None or self._controls is None:
            return self._receive_one_by_one()
        self._controls.clear()
        count: int = self._recvmmsg(
            self.socket.fileno(), self._headers.ctypes.data, self.batch, socket.MSG_DONTWAIT, None)
        if count < 0:
            number = ctypes.get_errno()
            if number in (errno.EAGAIN, errno.EINTR, errno.ECONNREFUSED):
                return 0
            raise OSError(number, 'recvmmsg')
        self.lengths[:count] = self._lengths[:count]
        self._controls.say_how(self.sources[:count])
        return count

    def _receive_one_by_one(self) -> int:
        if self.socket.fileno() < 0:
            raise OSError(errno.EBADF, 'the receiver was closed')
        for count in range(self.batch):
            try:
                self.lengths[count], (host, port) = self.socket.recvfrom_into(self.datagrams[count])
            except (BlockingIOError, ConnectionRefusedError):
                return count
            self.sources[count] = (socket.AF_INET, port, number_of(host), 0, 0)
        return self.batch

    def arrival(self, row: int) -> float:
        """When a row's datagram reached this machine, by time.monotonic(); now, if the kernel does not say [s]."""
        now = time.monotonic()
        at = None if self._controls is None else self._controls.arrived(row)
        if at is None:
            return now
        arrived = at - self._offset()
        return arrived if 0 <= now - arrived <= MAX_QUEUEING else now

    def marked(self, rows: IntArray) -> int:
        """How many of some rows' datagrams a congested queue has marked (ECN)."""
        return 0 if self._controls is None else self._controls.marked(rows)

    def shortage(self, wanted: int) -> Optional[str]:
        """What to do where the kernel has not granted a receive buffer of `wanted` bytes; None: it has."""
        if self.receive_buffer >= 2 * wanted:   # the kernel adds its own overhead: twice the size
            return None
        return '%d bytes only, sudo sysctl -w net.core.rmem_max=%d' % (self.receive_buffer // 2, wanted)

    def kernel_drops(self) -> Optional[int]:
        """Datagrams that the kernel dropped because the receive buffer was full; None if unknown."""
        try:
            memory = self.socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 64)
            return int(struct.unpack_from('=I', memory, 4 * MEMINFO_DROPS)[0])
        except (OSError, struct.error):
            return None

    def wake(self) -> None:
        """Make another thread's `wait` return at once, and every later one."""
        with contextlib.suppress(OSError):   # ENOTCONN, but Linux wakes the poll
            self.socket.shutdown(socket.SHUT_RD)

    def close(self) -> None:
        """Free the socket and the slots, in the thread that receives.

        Who keeps the ended connection, such as Python's garbage collector, keeps little then.
        """
        self.socket.close()
        self.datagrams = self.datagrams[:0].copy()


SHORT_BUFFER = 'the kernel grants a receive buffer that is too short for bursts'
"""What is wrong where DatagramReceiver.shortage is not None."""


def _mapped(shape: Tuple[int, ...], dtype: Any) -> Array:
    """Zeros in a mapping of their own, which returns to the kernel when the array is freed.

    malloc would keep the memory of ended connections, and add to it with each connection that is made anew.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    populate = MAP_POPULATE if size <= MAX_POPULATED else 0
    memory = mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | populate)
    return np.frombuffer(memory, dtype).reshape(shape)


def _find_recvmmsg() -> Any:
    try:
        function = ctypes.CDLL(None, use_errno=True).recvmmsg
    except (OSError, AttributeError):
        return None
    function.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)
    return function


def _grow_receive_buffer(sock: socket.socket, size: int) -> int:
    """Request a receive buffer; returns the size granted, which includes the kernel's overhead [byte]."""
    for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):
        try:
            sock.setsockopt(socket.SOL_SOCKET, option, size)
            break
        except PermissionError:
            continue
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def addresses_of(host: Optional[str]) -> Set[int]:
    """The IPv4 addresses of a host name as numbers; empty if it is unknown."""
    try:
        found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, ValueError):   # ValueError: not a name, such as one with a label of 64 characters
        return set()
    return {number_of(info[4][0]) for info in found}


def number_of(address: str) -> int:
    """A numeric IPv4 address as a number.

    :raises OSError: if it is not one
    """
    return int.from_bytes(socket.inet_aton(address), 'big')


def is_loopback(address: int) -> bool:
    """Whether an IPv4 address, as a number, is the machine's own."""
    return address & LOOPBACK[1] == LOOPBACK[0]


def is_own(host: str) -> bool:
    """Whether a host name or address is this machine's; True if the name is unknown."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((host, 0))
        return True
    except OSError as error:
        return error.errno != errno.EADDRNOTAVAIL
    except UnicodeError:
        return True
