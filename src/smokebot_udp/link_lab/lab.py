# SPDX-License-Identifier: BSD-3-Clause
"""Two network namespaces, robot and operator, joined by an emulated link; Linux, root.

One process holds both namespaces and moves the packets between a TUN device in each. They live as long as it does:
nothing has to be cleaned up, however it ends. It is driven by lines of JSON on its standard input, each answered
by one; `Lab` does that.
"""
import contextlib
import ctypes
import dataclasses
import fcntl
import gc
import heapq
import json
import os
import select
import struct
import subprocess
import sys
import time

from .channel import Channel
from .course import SIDES, changed

ADDRESSES = {'robot': '10.77.0.1', 'operator': '10.77.0.2'}
DEVICE = 'air'
MTU = 1500
CLONE_NEWNET = 0x40000000
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454ca, 0x0001, 0x1000
READ_AT_ONCE = 32

QUEUE = 10000
"""Packets that the kernel holds until this process takes them; more than it ever is late for."""


MASTER = 'http://%s:11311' % ADDRESSES['robot']
"""The ROS master is the robot's."""


class LabError(Exception):
    """The lab cannot be built here; the message says why."""


class Lab:
    """The link, and commands on its two sides. A context manager.

    :param seed: of what the link does
    :param congestion_control: TCP's, on both sides: cubic, bbr, ...
    :raises LabError: where this process may not, or the kernel cannot
    """

    def __init__(self, seed=0, congestion_control='cubic'):
        if os.geteuid() != 0:
            raise LabError('only root can make network namespaces: run it with sudo')
        self._process = subprocess.Popen(
            [sys.executable, '-m', __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            universal_newlines=True, env=dict(os.environ, PYTHONPATH=os.pathsep.join(sys.path)))
        answer = self._ask({'seed': seed, 'congestion_control': congestion_control})
        self._namespaces = {side: '/proc/%d/fd/%d' % (self._process.pid, answer[side]) for side in SIDES}

    def _ask(self, message):
        try:
            self._process.stdin.write(json.dumps(message) + '\n')
            self._process.stdin.flush()
        except BrokenPipeError:
            pass
        line = self._process.stdout.readline()
        if not line:
            words = self._process.stderr.read().strip().splitlines()
            raise LabError('the link ended: %s' % (words[-1] if words else 'exit code %r' % self._process.wait()))
        answer = json.loads(line)
        if 'error' in answer:
            raise ValueError(answer['error'])
        return answer

    def set(self, both=None, **sides):
        """Change the quality of the link while it runs: set({'loss': 0.3}), set(robot={'rate': 1e6}).

        :raises ValueError: naming the value that is impossible; nothing is changed then
        """
        self._ask({side: {**(both or {}), **sides.get(side, {})} for side in SIDES})

    def counts(self):
        """{side: what it sent}, `late`: of packets since the last call [s], `waited`: {side: {ms: packets}}."""
        answer = self._ask({})
        answer['waited'] = {side: {int(ms): count for ms, count in waited.items()}
                            for side, waited in answer['waited'].items()}
        return answer

    def statistics(self):
        """`counts`, and for each side `missed`: packets that this process failed to take."""
        answer = self.counts()
        for side in SIDES:
            counters = self.run(side, ['cat', '/proc/net/dev'], stdout=subprocess.PIPE, check=True).stdout.decode()
            answer[side]['missed'] = int(counters.split(DEVICE + ':')[1].split()[11])
        return answer

    def command(self, side, arguments):
        """What runs a command on a side."""
        return ['nsenter', '--net=' + self._namespaces[side], *arguments]

    def run(self, side, arguments, **options):
        """subprocess.run on a side."""
        return subprocess.run(self.command(side, arguments), **options)

    def popen(self, side, arguments, **options):
        """subprocess.Popen on a side."""
        return subprocess.Popen(self.command(side, arguments), **options)

    def close(self):
        self._process.stdin.close()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()
        self._process.stderr.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def environment(side):
    """os.environ for a ROS node on a side."""
    # ROS_HOSTNAME would count before ROS_IP
    rest = {name: value for name, value in os.environ.items() if name != 'ROS_HOSTNAME'}
    return {**rest, 'ROS_IP': ADDRESSES[side], 'ROS_MASTER_URI': MASTER}


def make_side(side, congestion_control):
    """Move this process into a new namespace with a TUN device: (namespace's fd, device's fd)."""
    other = next(name for name in SIDES if name != side)
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), 'unshare: ' + os.strerror(ctypes.get_errno()))
    # stray packets would take draws from the link, and remembered metrics make runs differ
    for key in ('ipv6/conf/all/disable_ipv6', 'ipv6/conf/default/disable_ipv6', 'ipv4/tcp_no_metrics_save'):
        try:
            with open('/proc/sys/net/' + key, 'w') as file:
                file.write('1')
        except FileNotFoundError:
            pass
    device = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack('16sH22x', DEVICE.encode(), IFF_TUN | IFF_NO_PI))
    for line in ('link set lo up', 'addr add %s peer %s dev %s' % (ADDRESSES[side], ADDRESSES[other], DEVICE),
                 'link set %s mtu %d txqueuelen %d up' % (DEVICE, MTU, QUEUE),
                 'route replace %s dev %s src %s congctl %s' % (
                     ADDRESSES[other], DEVICE, ADDRESSES[side], congestion_control)):
        subprocess.run(['ip', *line.split()], check=True)
    return os.open('/proc/self/ns/net', os.O_RDONLY), device


class Carrier:
    """Moves the packets, each when its channel says."""

    def __init__(self, devices, seed):
        self.channels = {side: Channel(seed='%s %s' % (seed, side)) for side in SIDES}
        robot, operator = (devices[side] for side in SIDES)
        self._ways = [(robot, self.channels['robot'], operator), (operator, self.channels['operator'], robot)]
        self._heap, self._count = [], 0     # (when, number, device, packet)
        self.late = []                      # how late packets left since this was asked for [s]

    def run(self, control, obey):
        """Until obey() says no; it is called when `control` has something to read."""
        devices = [device for device, _, _ in self._ways]
        while True:
            wait = max(0.0, self._heap[0][0] - time.monotonic()) if self._heap else None
            ready = select.select([*devices, control], (), (), wait)[0]
            for device, channel, out in self._ways:
                if device in ready:
                    self._take(device, channel, out)
            self._deliver()
            if control in ready and not obey():
                return

    def _take(self, device, channel, out):
        for _ in range(READ_AT_ONCE):
            try:
                packet = os.read(device, 65536)
            except BlockingIOError:
                return
            for due in channel.fate(time.monotonic(), len(packet)):
                self._count += 1
                heapq.heappush(self._heap, (due, self._count, out, packet))

    def _deliver(self):
        now = time.monotonic()
        while self._heap and self._heap[0][0] <= now:
            due, _, out, packet = heapq.heappop(self._heap)
            self.late.append(now - due)
            with contextlib.suppress(OSError):    # the other side's device went down
                os.write(out, packet)
            now = time.monotonic()


def serve():
    """The process behind a Lab."""
    configuration = json.loads(sys.stdin.readline())
    made = {side: make_side(side, configuration['congestion_control']) for side in SIDES}
    carrier = Carrier({side: device for side, (_, device) in made.items()}, configuration['seed'])
    gc.disable()     # nothing here makes cycles, and a pause is a late packet
    try:
        with open('/proc/self/timerslack_ns', 'w') as file:
            file.write('1')
    except OSError:
        pass
    print(json.dumps({side: namespace for side, (namespace, _) in made.items()}), flush=True)
    pending = bytearray()

    def obey():
        data = os.read(sys.stdin.fileno(), 65536)
        pending.extend(data)
        while b'\n' in pending:
            line, _, rest = bytes(pending).partition(b'\n')
            pending[:] = rest
            print(json.dumps(_answer(carrier, json.loads(line.decode()))), flush=True)
        return bool(data)

    carrier.run(sys.stdin.fileno(), obey)


def _answer(carrier, changes):
    """Change what is asked for, and tell what happened so far."""
    try:
        wanted = {side: changed(carrier.channels[side].quality, some) for side, some in changes.items()}
    except (ValueError, TypeError) as error:
        return {'error': str(error)}
    for side, quality in wanted.items():
        carrier.channels[side].quality = quality
    late = sorted(carrier.late)
    carrier.late.clear()
    return {**{side: dataclasses.asdict(channel.counts) for side, channel in carrier.channels.items()},
            'waited': {side: channel.waited for side, channel in carrier.channels.items()},
            'late': {'p50': late[len(late) // 2], 'p99': late[len(late) * 99 // 100]} if late else {}}


if __name__ == '__main__':
    serve()
