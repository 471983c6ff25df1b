# SPDX-License-Identifier: BSD-3-Clause
"""Real sockets on the loopback device."""
import errno
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest
from polling import WAIT

from smokebot_udp import traffic
from smokebot_udp.udpros import control_messages, endpoints
from smokebot_udp.udpros.control_messages import Via
from smokebot_udp.udpros.endpoints import (
    BatchSender,
    ClockOffset,
    DatagramReceiver,
    DatagramSender,
    PeerGone,
    addresses_of,
    interface_name,
    path_payload,
)

LOCALHOST = 0x7f000001


@pytest.fixture
def make() -> Any:
    """Make a DatagramReceiver or a DatagramSender that is closed after the test."""
    made = []

    def make_one(kind, *args, **kwargs) -> Any:
        made.append(kind(*args, **kwargs))
        return made[-1]

    yield make_one
    for endpoint in made:
        endpoint.close()


@pytest.fixture(params=[True, False], ids=['recvmmsg', 'recvfrom_into'])
def receiver(request, make) -> Any:
    made = make(DatagramReceiver, '127.0.0.1', 200, recvmmsg=request.param)
    assert made.recvmmsg == request.param
    return made


def collect(receiver, count) -> Any:
    """[(datagram, source port)] of the next `count` datagrams."""
    got = []
    while len(got) < count:
        assert receiver.wait(WAIT), 'only %d of %d arrived' % (len(got), count)
        for row in range(receiver.receive()):
            assert receiver.sources['family'][row] == socket.AF_INET
            assert receiver.sources['address'][row] == LOCALHOST
            got.append((receiver.datagrams[row, :receiver.lengths[row]].tobytes(), int(receiver.sources['port'][row])))
    return got


def test_answers_come_from_the_address_that_was_asked(make) -> None:
    robot, desk = make(DatagramReceiver, '', 200), make(DatagramReceiver, '127.0.0.1', 200)
    BatchSender(desk.socket).send_one(b'question', to=('127.0.0.2', robot.address[1]))
    assert robot.wait(WAIT) and robot.receive() == 1
    source = robot.sources[0]
    via = Via(int(source['interface']), int(source['local']))
    assert via == Via(0, LOCALHOST + 1)
    assert BatchSender(robot.socket).send(bytes(300), 100, 3, to=('127.0.0.1', desk.address[1]), via=via) == 3
    assert desk.wait(WAIT) and desk.receive() == 3
    assert set(desk.sources['address'][:3].tolist()) == {LOCALHOST + 1}
    BatchSender(desk.socket).send_one(b'question', to=('127.0.0.1', robot.address[1]))
    assert robot.wait(WAIT) and robot.receive() == 1 and robot.sources['local'][0] == LOCALHOST


@pytest.mark.parametrize('via', [Via(1 << 20), Via(0, 0x01020304)])
def test_by_what_this_machine_does_not_have_nothing_is_sent(make, via) -> None:
    sender, other = BatchSender(make(DatagramReceiver, '', 200).socket), make(DatagramReceiver, '127.0.0.1', 200)
    assert sender.send(bytes(300), 100, 3, to=('127.0.0.1', other.address[1]), via=via) == 0
    assert sender.send_one(b'one', to=('127.0.0.1', other.address[1]), via=via) == 0
    assert list(sender.failures.values()) == [4]
    assert sender.send_one(b'one', to=('127.0.0.1', other.address[1])) == 1


def test_the_name_of_an_interface() -> None:
    index = socket.if_nametoindex('lo')
    assert [interface_name(one) for one in (index, 0, 1 << 20)] == ['lo', '', '']
    assert path_payload('127.0.0.1', 9, Via(index)) == path_payload('127.0.0.1', 9)


def test_one_socket_sends_to_several_addresses_and_receives(make) -> None:
    both, others = make(DatagramReceiver, '', 200), [make(DatagramReceiver, '127.0.0.1', 200) for _ in range(2)]
    sender = BatchSender(both.socket)
    for number, other in enumerate(others):
        assert sender.send(bytes([number]) * 950, 100, 10, to=('127.0.0.1', other.address[1])) == 10
        assert sender.send_one(b'a', b'b', to=('127.0.0.1', other.address[1])) == 1
        got = collect(other, 11)
        assert [data for data, _ in got] == [bytes([number]) * 100] * 9 + [bytes([number]) * 50, b'ab']
        assert {port for _, port in got} == {both.address[1]}
        assert BatchSender(other.socket).send_one(b'back', to=('127.0.0.1', both.address[1])) == 1
    assert [port for _, port in collect(both, 2)] == [other.address[1] for other in others]
    assert sender.send_one(b'x', to=('127.0.0.1', closed_port())) == 1      # nobody tells
    assert sender.send_one(b'x', to=('255.255.255.255', 9)) == 0 and sender.failures == {'EACCES': 1}


def test_a_port_in_use_is_an_error(make) -> None:
    port = make(DatagramReceiver, '127.0.0.1', 200).address[1]
    with pytest.raises(OSError, match='in use'):
        DatagramReceiver('127.0.0.1', 200, port=port)


def closed_port() -> Any:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


def kernel_has_gso() -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.setsockopt(socket.IPPROTO_UDP, endpoints.UDP_SEGMENT, 100)
        except OSError:
            return False
    return True


# -- DatagramSender ------------------------------------------------------------------------------------------


@pytest.mark.parametrize('gso', [True, False], ids=['gso', 'plain'])
@pytest.mark.parametrize(('count', 'last'), [(1, 150), (2, 150), (3, 1), (64, 150), (65, 149), (300, 7)])
def test_many_datagrams(receiver, make, gso, count, last) -> None:
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1], gso)
    data = np.random.default_rng(1).integers(0, 256, 150 * (count - 1) + last, np.uint8)
    assert sender.send(data, 150, count) == count
    assert collect(receiver, count) == [
        (data[at:at + 150].tobytes(), sender.local[1]) for at in range(0, len(data), 150)]
    assert not sender.failures


@pytest.mark.parametrize('gso', [True, False], ids=['gso', 'plain'])
def test_rows_of_a_frame_and_the_longest_bursts(make, gso) -> None:
    receiver = make(DatagramReceiver, '127.0.0.1', 1472)
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1], gso)
    rows = np.random.default_rng(2).integers(0, 256, (100, 1472), np.uint8)
    assert sender.send(rows, 1472, 100) == 100
    assert [datagram for datagram, _ in collect(receiver, 100)] == [row.tobytes() for row in rows]
    assert sender.gso == (gso and kernel_has_gso())    # otherwise the plain path is compared with itself


def test_without_gso_datagrams_are_sent_one_by_one(receiver, make, monkeypatch) -> None:
    monkeypatch.setattr(endpoints, 'UDP_SEGMENT', 9999)     # unknown to every kernel
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    assert sender.send(bytes(range(250)), 100, 3) == 3
    assert not sender.gso
    assert sender.send(bytes(range(250)), 100, 3) == 3
    assert [len(datagram) for datagram, _ in collect(receiver, 6)] == [100, 100, 50] * 2
    assert not sender.failures


def test_gso_comes_back_when_the_path_carries_long_datagrams_again(receiver, make, monkeypatch) -> None:
    """The kernel refuses it for datagrams above the path MTU; those that are shorter use it all the time."""
    now, longest, calls = [1000.0], [200], []
    monkeypatch.setattr(endpoints.time, 'monotonic', lambda: now[0])

    class Socket:
        """The path MTU of the loopback device is that of the whole machine: only the kernel's answer is made up."""

        def __init__(self, sock) -> None:
            self._sock = sock

        def sendmsg(self, parts, control, *rest) -> int:
            calls.append(bool(control))
            if control and struct.unpack('=H', control[0][2])[0] > longest[0]:
                raise OSError(errno.EMSGSIZE, 'Message too long')
            return self._sock.sendmsg(parts, control, *rest)

        def __getattr__(self, name) -> object:
            return getattr(self._sock, name)

    def send(size: int) -> list:
        calls.clear()
        assert sender.send(bytes(3 * size), size, 3) == 3
        return list(calls)
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    sender.socket = Socket(sender.socket)
    assert send(300) == [True, False, False, False] and send(300) == [False] * 3 and send(250) == [True] + [False] * 3
    assert send(200) == [True]
    now[0], longest[0] = now[0] + endpoints.GSO_RETRY + 1, 1400
    assert send(300) == [False] * 3      # now and then one by one, see PLAIN_PERIOD
    assert send(300) == [True] and send(300) == [True]
    assert len(collect(receiver, 21)) == 21 and not sender.failures


def test_the_kernel_learns_the_path_mtu_although_gso_is_in_use(receiver, make, monkeypatch) -> None:
    """Only what is sent one by one has the bit DF: those bursts come now and then, and not always."""
    now, calls = [1000.0], []
    monkeypatch.setattr(endpoints.time, 'monotonic', lambda: now[0])
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])

    sendmsg = sender.socket.sendmsg

    class Socket:
        def sendmsg(self, parts, control, *rest) -> int:
            calls.append((now[0], bool(control)))
            return sendmsg(parts, control, *rest)

        def __getattr__(self, name) -> object:
            return getattr(real, name)
    real, sender.socket = sender.socket, Socket()
    for tenth in range(200):
        now[0] = 1000.0 + tenth / 10
        sender.send(bytes(300), 100, 3)
    plain = sorted({when for when, gso in calls if not gso})
    assert 3 <= len(plain) <= 4 and all(5.0 <= later - one < 5.3 for one, later in zip(plain, plain[1:]))


SHRUNK = """
import subprocess
from smokebot_udp.udpros.endpoints import DatagramReceiver, DatagramSender
def mtu(size):
    subprocess.run(['ip', 'link', 'set', 'lo', 'mtu', str(size)], check=True)
subprocess.run(['ip', 'link', 'set', 'lo', 'up'], check=True)
receiver = DatagramReceiver('127.0.0.1', 1472)
sender = DatagramSender('127.0.0.1', receiver.address[1])
for size, gso in ((65536, True), (1300, False)):
    mtu(size)
    assert sender.send(bytes(4 * 1400), 1400, 4) == 4
    print(sender.gso == gso, sender.failures)
    assert sender.send(bytes(4 * 1200), 1200, 4) == 4
"""


def test_gso_and_a_device_whose_mtu_shrinks() -> None:
    if os.geteuid() != 0 or not kernel_has_gso():
        pytest.skip('needs root, for a network of its own, and a kernel with UDP GSO')
    done = subprocess.run(['unshare', '--net', sys.executable, '-c', SHRUNK], stdout=subprocess.PIPE, check=True)
    assert done.stdout.split() == [b'True', b'Counter()'] * 2


def test_one_datagram_in_parts(receiver, make) -> None:
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    assert sender.send_one(b'head', np.arange(3, dtype=np.uint8), b'') == 1
    assert collect(receiver, 1) == [(b'head\0\1\2', sender.local[1])]


def test_a_datagram_too_long_for_udp_is_counted(receiver, make) -> None:
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    assert sender.send_one(bytes(65508)) == 0
    assert sender.failures == {'EMSGSIZE': 1}
    assert sender.send_one(b'after') == 1


@pytest.mark.parametrize('gso', [True, False], ids=['gso', 'plain'])
def test_a_peer_that_is_gone(make, gso) -> None:
    sender = make(DatagramSender, '127.0.0.1', closed_port(), gso)
    with pytest.raises(PeerGone, match=r'the port of 127\.0\.0\.1:\d+ is closed'):
        for _ in range(3):      # the error is reported by the next call
            sender.send(bytes(400), 100, 4)
    with pytest.raises(PeerGone):
        for _ in range(3):
            sender.send_one(b'x')


def test_hosts_that_do_not_exist() -> None:
    for host in ('no.such.host.invalid', 'x' * 70):
        with pytest.raises((OSError, UnicodeError)):
            DatagramSender(host, 5)
        with pytest.raises((OSError, UnicodeError)):
            path_payload(host, 5)


def test_a_closed_receiver_raises(receiver) -> None:
    receiver.close()
    with pytest.raises(OSError):
        receiver.receive()


def test_a_closed_sender_raises(receiver, make) -> None:
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    sender.close()
    with pytest.raises(OSError):
        sender.send_one(b'x')


def test_network_errors_are_counted_and_not_raised(receiver, make) -> None:
    """No route, no buffer, a firewall: the errors are made up here, as a test has no cable to pull."""
    class Network:
        def __init__(self, errors) -> None:
            self.errors = list(errors)

        def sendmsg(self, parts, *options) -> Any:
            if self.errors:
                raise OSError(self.errors.pop(0), 'made up')
            return socket_.sendmsg(parts, *options)

    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    socket_ = sender.socket
    sender.socket = Network([101, 113, 1])
    try:
        assert sender.send(bytes(500), 100, 5) == 0
        assert [sender.send_one(b'x') for _ in range(3)] == [0, 0, 1]
        assert sender.failures == {'ENETUNREACH': 5, 'EHOSTUNREACH': 1, 'EPERM': 1}
    finally:
        sender.socket = socket_


def test_path_payload() -> None:
    assert path_payload('127.0.0.1', 9) == min(65507, path_mtu() - 28)


def path_mtu() -> Any:
    with open('/sys/class/net/lo/mtu') as file:
        return int(file.read())


# -- the second byte of IP headers -----------------------------------------------------------------------------

@pytest.fixture
def headers() -> Any:
    """A socket, and f(n) -> {(TOS, datagram)} of the next n datagrams."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(('127.0.0.1', 0))
        bound.settimeout(WAIT)
        bound.setsockopt(socket.IPPROTO_IP, control_messages.IP_RECVTOS, 1)

        def read(count) -> Any:
            found = []
            for _ in range(count):
                data, control, _, _ = bound.recvmsg(2000, 100)
                (level, kind, value), = control
                assert (level, kind) == (socket.IPPROTO_IP, socket.IP_TOS)
                found.append((value[0], data))
            return found

        yield bound, read


@pytest.mark.parametrize('gso', [True, False])
def test_senders_of_one_socket_have_headers_of_their_own(headers, make, gso) -> None:
    (_, read), to = headers, headers[0].getsockname()
    one = BatchSender(make(DatagramReceiver, '127.0.0.1', 200).socket, gso)
    other = one.another(traffic.IMAGES | traffic.ECT)
    one.tos = traffic.EXPEDITED
    one.send_one(b'first', to=to)
    other.send(b'a' * 100 + b'b' * 100 + b'c', 100, 3, to=to)
    one.send_one(b'last', to=to)
    assert read(5) == [(0xb8, b'first'), (0x8a, b'a' * 100), (0x8a, b'b' * 100), (0x8a, b'c'), (0xb8, b'last')]
    assert not one.failures and not other.failures
    other.tos = 0
    other.send_one(b'plain', to=to)
    assert read(1) == [(0, b'plain')]


def test_each_thread_sends_with_its_own_header(headers, make) -> None:
    (_, read), to = headers, headers[0].getsockname()
    first = BatchSender(make(DatagramReceiver, '127.0.0.1', 200).socket)
    senders = [first.another(tos) for tos in (0xb8, 0x8a, 0x6a, 0x02)]
    threads = [threading.Thread(target=lambda sender=sender: [sender.send_one(b'%d' % sender.tos, to=to)
                                                              for _ in range(50)]) for sender in senders]
    for thread in threads:
        thread.start()
    assert all(data == b'%d' % tos for tos, data in read(200))
    for thread in threads:
        thread.join(WAIT)


def test_priorities_of_this_machine_follow_the_header(make) -> None:
    sender = BatchSender(make(DatagramReceiver, '127.0.0.1', 200).socket)
    found = []
    for tos in (traffic.EXPEDITED, traffic.IMAGES | traffic.ECT, traffic.EXPEDITED | traffic.ECT, traffic.BULK):
        sender.tos = tos
        sender.send_one(b'x', to=('127.0.0.1', 9))
        found.append(sender.socket.getsockopt(socket.SOL_SOCKET, endpoints.SO_PRIORITY))
    assert found == [6, 0, 6, 0]


def test_headers_that_must_not_be_set_stop_nothing(make, receiver, monkeypatch) -> None:
    monkeypatch.setattr(endpoints, 'SO_PRIORITY', 12345)       # as a sandbox refuses it
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    sender.tos = traffic.EXPEDITED
    assert sender.send_one(b'first') == 1
    assert [data for data, _ in collect(receiver, 1)] == [b'first'] and not sender.failures


def test_what_congested_queues_mark_is_recognised(make) -> None:
    """CE only, whatever the DSCP is; a row's mark is not that of the datagram that was there before."""
    receiver = make(DatagramReceiver, '127.0.0.1', 200)
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    for tos in (0x03, 0x8b, 0x8a, 0x02, 0x01, 0x00, 0xbb):
        sender.tos = tos
        sender.send_one(b'x')
    assert receiver.wait(WAIT) and receiver.receive() == 7
    assert [receiver.marked(np.array([row])) for row in range(7)] == [1, 1, 0, 0, 0, 0, 1]
    assert receiver.marked(np.arange(7)) == 3 and receiver.marked(np.array([], int)) == 0
    sender.tos = 0
    sender.send_one(b'x')
    assert receiver.receive() == 1 and receiver.marked(np.array([0])) == 0


# -- DatagramReceiver ----------------------------------------------------------------------------------------


def test_batches_sources_and_lengths(receiver, make) -> None:
    senders = [make(DatagramSender, '127.0.0.1', receiver.address[1]) for _ in range(3)]
    expected = []
    for number in range(140):       # more than a batch
        sender = senders[number % 3]
        sender.send_one(bytes([number]) * number)
        expected.append((bytes([number]) * number, sender.local[1]))
    assert receiver.wait(WAIT)
    assert collect(receiver, 140) == expected
    assert receiver.receive() == 0
    assert not receiver.wait(0)


def test_too_long_datagrams_fill_their_slot(receiver, make) -> None:
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    for size in (199, 200, 201, 202, 5000):
        sender.send_one(bytes(size))
    assert [len(datagram) for datagram, _ in collect(receiver, 5)] == [199, 200, 201, 201, 201]


def test_a_short_datagram_leaves_no_length_behind(receiver, make) -> None:
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    for size in (150, 0, 3):
        sender.send_one(bytes(size))
        assert [len(datagram) for datagram, _ in collect(receiver, 1)] == [size]


def test_waking(receiver) -> None:
    """A thread that waits for an hour ends at once, and so does its next wait."""
    woken = threading.Event()

    def wait() -> None:
        receiver.wait(3600.0)
        receiver.wait(3600.0)
        woken.set()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    receiver.wake()
    assert woken.wait(WAIT)
    assert receiver.receive() == 0
    receiver.close()
    receiver.wake()     # and nothing happens


def test_the_receive_buffer_is_what_the_kernel_grants(make) -> None:
    receiver = make(DatagramReceiver, '127.0.0.1', 200, receive_buffer=50000)
    assert receiver.receive_buffer == receiver.socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) == 100000
    huge = make(DatagramReceiver, '127.0.0.1', 200, receive_buffer=1 << 30)
    assert huge.receive_buffer == huge.socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) > 100000


MEMORY = """
import psutil
from smokebot_udp.nodes.malloc_tuning import keep_freed_memory
from smokebot_udp.udpros.endpoints import DatagramReceiver

keep_freed_memory()
before = psutil.Process().memory_info().rss
receiver = DatagramReceiver('127.0.0.1', 1472, batch=8192)
receiver.datagrams[:] = 1
print(psutil.Process().memory_info().rss - before)
receiver.close()
print(psutil.Process().memory_info().rss - before)
del receiver
print(psutil.Process().memory_info().rss - before)
"""
"""A program that prints how much memory a receiver takes with its slots in use, when it is closed, and afterwards."""


def test_the_memory_of_an_ended_connection_returns_to_the_kernel() -> None:
    """Also where malloc keeps freed memory: each reconnection would add some to another arena."""
    taken, closed, left = map(int, subprocess.check_output([sys.executable, '-c', MEMORY]).split())
    assert taken > 12e6 and closed < taken - 12e6 and left < 1e6


SLOTS = """
import psutil
from smokebot_udp.udpros.endpoints import DatagramReceiver

receiver = DatagramReceiver('127.0.0.1', 1472)
before = psutil.Process().memory_info().rss
receiver.datagrams[:] = 1
print(psutil.Process().memory_info().rss - before)
"""
"""A program that prints by how much the memory grows when all slots are used [byte]."""


def test_a_long_burst_takes_no_memory_that_was_not_taken_before() -> None:
    assert int(subprocess.check_output([sys.executable, '-c', SLOTS])) < 65536


def test_the_kernels_drops_are_counted(make) -> None:
    receiver = make(DatagramReceiver, '127.0.0.1', 1472, receive_buffer=0)
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])
    assert receiver.kernel_drops() == 0
    assert sender.send(bytes(100 * 1472), 1472, 100) == 100
    got = receiver.receive()
    assert 0 < got < 100 and receiver.kernel_drops() == 100 - got
    receiver.close()
    assert receiver.kernel_drops() is None


def test_an_address_of_another_machine() -> None:
    before = os.listdir('/proc/self/fd')
    with pytest.raises(OSError) as failed:
        DatagramReceiver('192.0.2.1', 200)
    assert os.listdir('/proc/self/fd') == before
    assert failed.traceback     # which still holds the receiver


def test_addresses_of() -> None:
    assert addresses_of('127.0.0.1') == {LOCALHOST}
    assert addresses_of('192.0.2.255') == {0xc00002ff}
    assert LOCALHOST in addresses_of('localhost')


@pytest.mark.parametrize('host', [None, 'no.such.host.invalid', 'x' * 70, 'a\0b', 'two..dots'])
def test_addresses_of_unknown_hosts(host) -> None:
    assert addresses_of(host) == set()


def test_the_time_of_arrival_does_not_depend_on_when_a_datagram_is_received(receiver, make) -> None:
    sender = make(DatagramSender, '127.0.0.1', receiver.address[1])

    def is_known() -> bool:
        """Whether the time of arrival is known of a datagram that is received 0.1 s after it was sent."""
        sender.send_one(b'first')
        sent = time.monotonic()
        time.sleep(0.1)     # what must not count
        assert receiver.receive() == 1
        return receiver.arrival(0) < sent + 0.1

    if receiver.recvmmsg:       # the kernel stamps datagrams some time after the first socket has asked for it
        assert any(is_known() for _ in range(50))
    else:
        assert not is_known()


def test_the_offset_of_the_clocks_does_not_follow_interrupted_readings(monkeypatch) -> None:
    """The thread is interrupted for longer and longer between the readings of both clocks; then the clock is set."""
    now, interruption, step = 0.0, 0.0, 1000.0

    def wall() -> float:
        nonlocal now
        now += interruption
        return now + step

    monkeypatch.setattr(time, 'time', wall)
    monkeypatch.setattr(time, 'monotonic', lambda: now)
    offset = ClockOffset()
    first = offset()
    assert first == pytest.approx(1000.0, abs=1e-5)
    for seconds in (1e-6, 1e-3, 0.2):
        interruption = seconds
        assert offset() == first
    step, interruption = 1000.5, 0.0
    assert offset() == pytest.approx(1000.5, abs=1e-5)


@pytest.mark.parametrize('step', [3600.0, -3600.0])
def test_a_clock_that_was_set_does_not_falsify_the_time_of_arrival(receiver, make, monkeypatch, step) -> None:
    before = time.monotonic()
    make(DatagramSender, '127.0.0.1', receiver.address[1]).send_one(b'first')
    assert receiver.wait(WAIT) and receiver.receive() == 1
    clock = time.time
    monkeypatch.setattr(time, 'time', lambda: clock() + step)
    assert before <= receiver.arrival(0) <= time.monotonic()


def test_addresses_of_this_machine() -> None:
    assert all(map(endpoints.is_own, ('127.0.0.1', '127.0.1.1', 'localhost', '0.0.0.0')))
    assert not endpoints.is_own('192.0.2.1')        # RFC 5737: nobody's
    assert endpoints.is_own('no.such.host.invalid') and endpoints.is_own('x' * 64)      # unknown
    assert endpoints.is_loopback(endpoints.number_of('127.3.4.5'))
    assert not endpoints.is_loopback(endpoints.number_of('128.0.0.1'))
