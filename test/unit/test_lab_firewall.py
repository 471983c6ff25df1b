# SPDX-License-Identifier: BSD-3-Clause
"""The lab's firewall lets the operator speak to the robot's port, and the robot answer; it says what else was tried."""
import shutil
import subprocess
import sys
from typing import Any, Iterator

import pytest
from polling import WAIT, wait_for

from evaluation.firewall import Firewall
from smokebot_udp.link_lab.lab import ADDRESSES, Lab, LabError

PORT = 17001
SIDES = 'robot', 'operator'

ECHO = """
import socket
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(('', %d))
print('bound', flush=True)
while True:
    data, source = s.recvfrom(2000)
    s.sendto(data, source)
""" % PORT

ASK = """
import socket, sys
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.settimeout(float(sys.argv[3]))
try:
    s.sendto(b'hello', (sys.argv[1], int(sys.argv[2])))
    print(s.recvfrom(100)[0].decode())
except OSError:
    print('nothing')
"""

CONNECT = """
import socket, sys
s = socket.socket()
s.settimeout(0.5)
s.connect_ex((sys.argv[1], int(sys.argv[2])))
"""


@pytest.fixture
def lab() -> Iterator[Lab]:
    if shutil.which('nft') is None:
        pytest.skip('nftables is not installed')
    try:
        with Lab() as lab:
            yield lab
    except LabError as error:
        pytest.skip(str(error))


@pytest.fixture
def echo(lab) -> Iterator[Any]:
    """A program on the robot's side that returns what reaches its port."""
    process = lab.popen('robot', [sys.executable, '-c', ECHO], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b'bound\n'
    yield process
    process.kill()
    process.communicate()


ANSWER, SILENCE = WAIT, 1.0
"""How long an answer is waited for that has to come, and one that must not [s]."""


def run(lab: Lab, side: str, script: str, *arguments: object) -> str:
    done = lab.run(side, [sys.executable, '-c', script, *map(str, arguments)], stdout=subprocess.PIPE)
    return str(done.stdout.decode().strip())


def test_the_operator_gets_its_answers(lab, echo) -> None:
    walls = {side: Firewall(lab, side, PORT) for side in SIDES}
    assert run(lab, 'operator', ASK, ADDRESSES['robot'], PORT, ANSWER) == 'hello'
    assert [wall.counts() for wall in walls.values()] == [{'passed': 2, 'icmp_packets': 0, 'refused': 0}] * 2
    assert [wall.tried() for wall in walls.values()] == [[], []]


def test_all_else_is_refused_and_named(lab, echo) -> None:
    wall = Firewall(lab, 'operator', PORT)
    assert run(lab, 'operator', ASK, ADDRESSES['robot'], PORT + 1, SILENCE) == 'nothing'
    run(lab, 'operator', CONNECT, ADDRESSES['robot'], 11311)
    assert wall.tried() == ['tcp port 11311', 'udp port %d' % (PORT + 1)]
    assert wall.counts()['refused'] >= 2 and wall.counts()['passed'] == 0


def test_the_robot_may_not_speak_first(lab) -> None:
    wall = Firewall(lab, 'robot', PORT)
    assert run(lab, 'robot', ASK, ADDRESSES['operator'], 4000, SILENCE) == 'nothing'
    assert wall.tried() == ['udp port 4000'] and wall.counts()['passed'] == 0


def test_a_closed_port_is_reported_by_icmp(lab) -> None:
    walls = [Firewall(lab, side, PORT) for side in SIDES]
    assert run(lab, 'operator', ASK, ADDRESSES['robot'], PORT, SILENCE) == 'nothing'
    wait_for(lambda: [wall.counts() for wall in walls] == [{'passed': 1, 'icmp_packets': 1, 'refused': 0}] * 2)
