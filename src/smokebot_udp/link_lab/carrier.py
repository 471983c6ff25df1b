# SPDX-License-Identifier: BSD-3-Clause
"""The process behind a Lab: makes both network namespaces, and carries the packets between a TUN device in each.

The namespaces live as long as the process: nothing has to be cleaned up, however it ends. It is controlled by lines of
JSON on its standard input, each answered by one line.
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
from typing import Any, Callable, Dict, List, Mapping, Tuple

from .channel import Air, Channel
from .ecn import is_capable, marked
from .lab import DEVICE, side_commands
from .link_trace import SIDES, changed

CLONE_NEWNET = 0x40000000
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454ca, 0x0001, 0x1000
MAX_READS = 32
"""Packets taken from one device before the other one is looked at."""

PROTOCOLS = {6: 'tcp', 17: 'udp'}
"""{protocol of an IPv4 packet: the flow that it is counted as}; others are 'other'"""

NICENESS = -15
"""A packet that waits for the processor would look like one that waits in the link's queue."""


def make_side(side: str, congestion_control: str) -> Tuple[int, int]:
    """Move this process into a new namespace with a TUN device: (namespace's fd, device's fd)."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), 'unshare: ' + os.strerror(ctypes.get_errno()))
    # stray packets would draw from the link's random streams, and cached metrics make runs differ
    for key in ('ipv6/conf/all/disable_ipv6', 'ipv6/conf/default/disable_ipv6', 'ipv4/tcp_no_metrics_save'):
        with contextlib.suppress(FileNotFoundError), open('/proc/sys/net/' + key, 'w') as file:
            file.write('1')
    device = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack('16sH22x', DEVICE.encode(), IFF_TUN | IFF_NO_PI))
    for line in side_commands(side, congestion_control):
        subprocess.run(['ip', *line.split()], check=True)
    return os.open('/proc/self/ns/net', os.O_RDONLY), device


def flow_of(packet: bytes) -> str:
    """The flow that an IPv4 packet is counted as, by its header's tenth byte (RFC 791)."""
    return PROTOCOLS.get(packet[9], 'other')


class Carrier:
    """Carries the packets, each when its channel says.

    :param devices: {side: its TUN device's fd}
    :param shared_air: whether both directions wait for one air
    """

    def __init__(self, devices: Mapping[str, int], seed: object, shared_air: bool = False) -> None:
        air = Air() if shared_air else None
        self.channels = {side: Channel(seed='%s %s' % (seed, side), air=air) for side in SIDES}
        robot, operator = (devices[side] for side in SIDES)
        self._directions = [(robot, self.channels['robot'], operator), (operator, self.channels['operator'], robot)]
        self._heap: List[Tuple[float, int, int, bytes]] = []    # (due [s], packet's number, device, packet)
        self._count = 0
        self.late: List[float] = []
        """By how much each packet left late, since this list was cleared [s]."""

    def run(self, control: int, obey: Callable[[], bool]) -> None:
        """Carry packets until obey() returns false; it is called when the fd `control` is readable."""
        devices = [device for device, _, _ in self._directions]
        while True:
            wait = max(0.0, self._heap[0][0] - time.monotonic()) if self._heap else None
            ready = select.select([*devices, control], (), (), wait)[0]
            for device, channel, out in self._directions:
                if device in ready:
                    self._take(device, channel, out)
            self._deliver()
            if control in ready and not obey():
                return

    def _take(self, device: int, channel: Channel, out: int) -> None:
        for _ in range(MAX_READS):
            try:
                packet = os.read(device, 65536)
            except BlockingIOError:
                return
            now, flow = time.monotonic(), flow_of(packet)
            if is_capable(packet) and channel.marks(now, flow):
                packet = marked(packet)
            for due in channel.fate(now, len(packet), flow):
                self._count += 1
                heapq.heappush(self._heap, (due, self._count, out, packet))

    def _deliver(self) -> None:
        now = time.monotonic()
        while self._heap and self._heap[0][0] <= now:
            due, _, out, packet = heapq.heappop(self._heap)
            self.late.append(now - due)
            with contextlib.suppress(OSError):    # the other side's device is down
                os.write(out, packet)
            now = time.monotonic()


def answer(carrier: Carrier, changes: Mapping[str, Mapping[str, Any]]) -> Dict[str, Any]:
    """Change the conditions, {side: {name: value}}, and return the counters; all or nothing is changed."""
    try:
        conditions = {side: changed(carrier.channels[side].conditions, some) for side, some in changes.items()}
    except (ValueError, TypeError) as error:
        return {'error': str(error)}
    for side, new in conditions.items():
        carrier.channels[side].conditions = new
    late = sorted(carrier.late)
    carrier.late.clear()
    return {**{side: dataclasses.asdict(channel.counts) for side, channel in carrier.channels.items()},
            'flows': {side: {flow: dataclasses.asdict(counts) for flow, counts in channel.flows.items()}
                      for side, channel in carrier.channels.items()},
            'waited': {side: channel.waited for side, channel in carrier.channels.items()},
            'late': {'p50': late[len(late) // 2], 'p99': late[len(late) * 99 // 100]} if late else {}}


def main() -> None:
    configuration = json.loads(sys.stdin.readline())
    sides = {side: make_side(side, configuration['congestion_control']) for side in SIDES}
    carrier = Carrier({side: device for side, (_, device) in sides.items()}, configuration['seed'],
                      configuration['shared_air'])
    gc.disable()     # there are no reference cycles here, and a pause makes packets late
    with contextlib.suppress(OSError):      # in a container
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    with contextlib.suppress(OSError), open('/proc/self/timerslack_ns', 'w') as file:
        file.write('1')
    print(json.dumps({side: namespace for side, (namespace, _) in sides.items()}), flush=True)
    pending = bytearray()

    def obey() -> bool:
        data = os.read(sys.stdin.fileno(), 65536)
        pending.extend(data)
        while b'\n' in pending:
            line, _, rest = bytes(pending).partition(b'\n')
            pending[:] = rest
            print(json.dumps(answer(carrier, json.loads(line.decode()))), flush=True)
        return bool(data)

    carrier.run(sys.stdin.fileno(), obey)


if __name__ == '__main__':
    main()
