# SPDX-License-Identifier: BSD-3-Clause
"""The sockets of UDPROS: batches of datagrams out (UDP GSO) and in (recvmmsg).

Linux only, as rospy's own use of it; where the kernel or the C library lacks either call, plain send and
recvfrom_into do the same, slower. IPv4, as roscpp's UDPROS.
"""
import collections
import contextlib
import ctypes
import errno
import select
import socket
import struct
import time

import numpy as np

from .datagram import UDP_MAX_PAYLOAD

UDP_SEGMENT = 103           # linux/udp.h: cut what is sent into datagrams of this size
MAX_SEGMENTS = 64           # linux/udp.h: UDP_MAX_SEGMENTS of the oldest kernels that have it
SO_RCVBUFFORCE = 33         # asm-generic/socket.h: beyond rmem_max, for those who may
SO_MEMINFO = 55             # asm-generic/socket.h: the socket's memory, and at
MEMINFO_DROPS = 8           # linux/sock_diag.h: SK_MEMINFO_DROPS
IP_MTU = 14                 # linux/in.h: the path's MTU, of a connected socket
IP_UDP_HEADERS = 28
SEND_PATIENCE = 0.05
"""How long a call waits for room in the socket before it drops what has none [s]."""

NO_GSO = (errno.EINVAL, errno.EIO, errno.EMSGSIZE, errno.ENOPROTOOPT, errno.EOPNOTSUPP)
"""Not on this kernel or device, or the path has become too narrow; plain sends are fragmented there."""


class PeerGone(Exception):
    """The peer's host says that nobody listens on that port any more (ICMP port unreachable)."""


def path_payload(host, port):
    """The longest UDP payload that reaches host unfragmented, as far as the kernel knows [byte].

    :raises OSError: where there is no such host or no way to it
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((host, port))
        return min(UDP_MAX_PAYLOAD, probe.getsockopt(socket.IPPROTO_IP, IP_MTU) - IP_UDP_HEADERS)


class DatagramSender:
    """Datagrams to one peer. No call waits longer than SEND_PATIENCE (and its pacer), whatever became of the peer.

    `failures` counts the datagrams that could not be sent, by the error's name: EPERM is a local firewall,
    EAGAIN a network device slower than we are, ENETUNREACH and EHOSTUNREACH a pulled cable.

    :raises OSError: where there is no such host or no way to it
    """

    def __init__(self, host, port, gso=True):
        self.failures = collections.Counter()
        self._gso = gso
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.setblocking(False)
            self.socket.connect((host, port))
            self.local, self.remote = self.socket.getsockname(), self.socket.getpeername()
            self._poll = select.poll()
            self._poll.register(self.socket, select.POLLOUT)
        except OSError:
            self.socket.close()
            raise

    def send_one(self, *parts):
        """Send one datagram, given in parts; returns the number of datagrams that left: 1 or 0."""
        return self._try(parts, (), 1, time.monotonic() + SEND_PATIENCE)

    def send(self, datagrams, size, count, pacer=None):
        """Send many datagrams.

        :param datagrams: bytes-like, one after the other, each `size` bytes, but the last may be shorter
        :param pacer: a Pacer, or None to send all at once
        :return: how many left
        :raises PeerGone: where the peer closed its port
        """
        view, sent, at = memoryview(datagrams).cast('B'), 0, 0
        deadline = time.monotonic() + SEND_PATIENCE
        most = min(MAX_SEGMENTS, UDP_MAX_PAYLOAD // size)
        if pacer is not None and pacer.rate is not None:
            most = max(1, min(most, int(pacer.burst // size)))
        while at < count:
            burst = min(most, count - at)
            piece = view[at * size:(at + burst) * size]
            if pacer is not None:
                wait = pacer.reserve(len(piece), time.monotonic()) - time.monotonic()
                if wait > 0:
                    time.sleep(wait)
                    deadline += wait
            sent += self._send_burst(piece, size, burst, deadline)
            at += burst
        return sent

    def _send_burst(self, piece, size, burst, deadline):
        if burst > 1 and self._gso:
            segment = [(socket.IPPROTO_UDP, UDP_SEGMENT, struct.pack('=H', size))]
            sent = self._try((piece,), segment, burst, deadline)
            if self._gso:
                return sent
        return sum(self._try((piece[at:at + size],), (), 1, deadline) for at in range(0, len(piece), size))

    def _try(self, parts, control, count, deadline):
        while True:
            try:
                self.socket.sendmsg(parts, control)
                return count
            except ConnectionRefusedError as error:
                raise PeerGone('nobody listens at %s:%d any more' % self.remote) from error
            except BlockingIOError:
                left = deadline - time.monotonic()
                if left > 0 and self._poll.poll(left * 1e3):
                    continue
                self.failures['EAGAIN'] += count
                return 0
            except OSError as error:
                if control and error.errno in NO_GSO:
                    self._gso = False    # the caller sends one by one
                    return 0
                if error.errno == errno.EBADF:
                    raise
                self.failures[errno.errorcode.get(error.errno, str(error.errno))] += count
                return 0

    def close(self):
        self.socket.close()


class _MsgHdr(ctypes.Structure):
    _fields_ = [('name', ctypes.c_void_p), ('namelen', ctypes.c_uint32), ('iov', ctypes.c_void_p),
                ('iovlen', ctypes.c_size_t), ('control', ctypes.c_void_p), ('controllen', ctypes.c_size_t),
                ('flags', ctypes.c_int)]


class _MMsgHdr(ctypes.Structure):
    _fields_ = [('hdr', _MsgHdr), ('len', ctypes.c_uint)]


TIMESTAMP = struct.Struct('@Nii2l')
"""A control message with a struct timespec: length, level, type, seconds, nanoseconds."""

SO_TIMESTAMPNS = 35
OLDEST = 1.0
"""A datagram that seems to have waited for longer in this machine did not: its clock was set [s]."""

SOCKADDR_IN = np.dtype([('family', '=u2'), ('port', '>u2'), ('address', '>u4'), ('zero', 'u1', (8,))])


class DatagramReceiver:
    """One bound UDP socket and a batch of receive slots.

    After `receive`, rows [0, n) of `datagrams`, `lengths` and `sources` describe what came, until the next
    call. A datagram longer than max_datagram_size has a length above it.

    :param receive_buffer: asked of the kernel [byte]; `receive_buffer` then says what it granted
    :param batch: most datagrams a call
    :raises OSError: where this machine has no such address
    """

    def __init__(self, address, max_datagram_size, receive_buffer=4 << 20, batch=512, recvmmsg=True):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.setblocking(False)
            self.receive_buffer = _grow_receive_buffer(self.socket, receive_buffer)
            self.socket.bind((address, 0))
        except OSError:
            self.socket.close()
            raise
        self.address = self.socket.getsockname()
        self.max_datagram_size = max_datagram_size
        # one byte more than may come tells a datagram that is too long
        self.datagrams = np.zeros((batch, max_datagram_size + 1), np.uint8)
        self.lengths = np.zeros(batch, np.int64)
        self.sources = np.zeros(batch, SOCKADDR_IN)
        self.batch = batch
        self._poll = select.poll()
        self._poll.register(self.socket, select.POLLIN)
        self._recvmmsg = _find_recvmmsg() if recvmmsg else None
        if self._recvmmsg:
            self._prepare()

    def _prepare(self):
        self._headers = (_MMsgHdr * self.batch)()
        self._iovecs = np.zeros((self.batch, 2), np.uintp)
        self._iovecs[:, 0] = self.datagrams.ctypes.data + self.datagrams.strides[0] * np.arange(self.batch)
        self._iovecs[:, 1] = self.datagrams.shape[1]
        view = np.frombuffer(self._headers, np.dtype(_MMsgHdr))
        header = view['hdr']
        header['name'] = self.sources.ctypes.data + SOCKADDR_IN.itemsize * np.arange(self.batch)
        header['namelen'] = SOCKADDR_IN.itemsize
        header['iov'] = self._iovecs.ctypes.data + self._iovecs.strides[0] * np.arange(self.batch)
        header['iovlen'] = 1
        self._lengths = view['len']
        self._control = np.zeros((self.batch, TIMESTAMP.size), np.uint8)
        header['control'] = self._control.ctypes.data + self._control.strides[0] * np.arange(self.batch)
        self._control_lengths = header['controllen']
        with contextlib.suppress(OSError):
            self.socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)

    def wait(self, timeout):
        """Whether there is something to receive within timeout [s] (or an error to be cleared)."""
        return bool(self._poll.poll(timeout * 1e3))

    def receive(self):
        """Take what has come, without waiting; returns how many datagrams, at most `batch`."""
        if self._recvmmsg is None:
            return self._receive_one_by_one()
        self._control_lengths[:] = TIMESTAMP.size
        count = self._recvmmsg(self.socket.fileno(), self._headers, self.batch, socket.MSG_DONTWAIT, None)
        if count < 0:
            number = ctypes.get_errno()
            if number in (errno.EAGAIN, errno.EINTR, errno.ECONNREFUSED):
                return 0
            raise OSError(number, 'recvmmsg')
        self.lengths[:count] = self._lengths[:count]
        return count

    def arrival(self, row):
        """When a row's datagram reached this machine, by time.monotonic(), however late it was taken [s]."""
        now = time.monotonic()
        if self._recvmmsg is None or self._control_lengths[row] < TIMESTAMP.size:
            return now
        _, _, _, seconds, nanoseconds = TIMESTAMP.unpack(self._control[row])
        age = time.time() - (seconds + 1e-9 * nanoseconds)
        return now - age if 0 <= age <= OLDEST else now

    def _receive_one_by_one(self):
        for count in range(self.batch):
            try:
                self.lengths[count], (host, port) = self.socket.recvfrom_into(self.datagrams[count])
            except (BlockingIOError, ConnectionRefusedError):
                return count
            self.sources[count] = (socket.AF_INET, port, int.from_bytes(socket.inet_aton(host), 'big'), [0] * 8)
        return self.batch

    def kernel_drops(self):
        """Datagrams that the kernel dropped because this socket's buffer was full; None where it does not say."""
        try:
            memory = self.socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 64)
            return struct.unpack_from('=I', memory, 4 * MEMINFO_DROPS)[0]
        except (OSError, struct.error):
            return None

    def wake(self):
        """Make another thread's `wait` return at once, and every later one."""
        with contextlib.suppress(OSError):   # ENOTCONN, and yet Linux wakes whoever polls
            self.socket.shutdown(socket.SHUT_RD)

    def close(self):
        self.socket.close()


def _find_recvmmsg():
    try:
        function = ctypes.CDLL(None, use_errno=True).recvmmsg
    except (OSError, AttributeError):
        return None
    function.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)
    return function


def _grow_receive_buffer(sock, size):
    """Ask for a receive buffer; returns what was granted, in bytes of the kernel's own accounting."""
    for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):
        try:
            sock.setsockopt(socket.SOL_SOCKET, option, size)
            break
        except PermissionError:
            continue
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def addresses_of(host):
    """The IPv4 addresses a host's name stands for: a set of int; empty where it is unknown."""
    try:
        found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, ValueError):   # ValueError: no name at all, as one with a label of 64 characters
        return set()
    return {int.from_bytes(socket.inet_aton(info[4][0]), 'big') for info in found}
