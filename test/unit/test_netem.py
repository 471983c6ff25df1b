# SPDX-License-Identifier: BSD-3-Clause
"""The lab's channel beside the kernel's own emulation, netem, where the kernel has it: the same loss and delay."""
import json
import math
import os
import subprocess
import sys
from typing import Any

import pytest

from smokebot_udp.link_lab.channel import Channel, LinkConditions

COUNT = 3000
CONDITIONS = LinkConditions(loss=0.2, delay=0.02)

NETEM = 'ip link set lo up && tc qdisc add dev lo root netem loss %g%% delay %gms limit %d' % (
    100 * CONDITIONS.loss, 1e3 * CONDITIONS.delay, 2 * COUNT)

ACROSS = """
import json, socket, time
receiver, sender = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 23)
receiver.bind(('127.0.0.1', 0))
receiver.settimeout(0.2)
sent, came, least = 0, 0, 1e9
while True:
    for _ in range(min(100, %d - sent)):
        sender.sendto(repr(time.monotonic()).encode(), receiver.getsockname())
        sent += 1
    try:
        for _ in range(100):
            stamp = float(receiver.recv(100))
            least = min(least, time.monotonic() - stamp)
            came += 1
    except socket.timeout:
        if sent == %d:
            break
print(json.dumps([came, least]))
""" % (COUNT, COUNT)


def in_a_namespace(command: str, *arguments: str) -> Any:
    """A shell command in a network namespace of its own."""
    return subprocess.run(['unshare', '--net', 'sh', '-c', command, *arguments], capture_output=True)


@pytest.fixture(scope='module')
def netem() -> str:
    if os.geteuid() != 0:
        pytest.skip('only root can make a network namespace')
    tried = in_a_namespace(NETEM)
    if tried.returncode:
        pytest.skip('this kernel has no netem: %s' % tried.stderr.decode().strip().splitlines()[-1])
    return NETEM


def test_the_channel_loses_and_delays_as_netem_does(netem: str) -> None:
    ran = in_a_namespace(netem + ' && exec "$0" -c "$1"', sys.executable, ACROSS)
    came, delay = json.loads(ran.stdout.decode())
    channel = Channel(CONDITIONS, seed=1)
    fates = [channel.fate(0.01 * number, 100) for number in range(COUNT)]
    ours = sum(map(len, fates))
    deviation = math.sqrt(2 * COUNT * CONDITIONS.loss * (1 - CONDITIONS.loss))
    assert abs(came - ours) < 5 * deviation
    assert delay >= CONDITIONS.delay
    for number, fate in enumerate(fates):
        assert not fate or fate[0] - 0.01 * number == pytest.approx(CONDITIONS.delay)
