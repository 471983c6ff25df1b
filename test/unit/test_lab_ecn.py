# SPDX-License-Identifier: BSD-3-Clause
"""The lab marks datagrams in its queue, as a real receiver reads them: the kernel drops what has a wrong checksum."""
import json
import subprocess
import sys
from typing import Any, Iterator, List

import pytest

from smokebot_udp.link_lab.lab import ADDRESSES, Lab, LabError

PORT, COUNT = 17002, 30

RECEIVE = """
import json, socket, sys
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(('', %d))
s.settimeout(30)
s.setsockopt(socket.IPPROTO_IP, 13, 1)      # IP_RECVTOS
print('bound', flush=True)
found = []
for _ in range(%d):
    data, control, _, _ = s.recvmsg(2000, 100)
    found.append(control[0][2][0])
print(json.dumps(found))
""" % (PORT, COUNT)

SEND = """
import socket, sys
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, int(sys.argv[2]))
for _ in range(%d):
    s.sendto(bytes(972), (sys.argv[1], %d))
""" % (COUNT, PORT)


@pytest.fixture
def lab() -> Iterator[Lab]:
    try:
        with Lab() as lab:
            yield lab
    except LabError as error:
        pytest.skip(str(error))


def heard(lab: Lab, tos: int) -> List[int]:
    """The second bytes of the IP headers as they arrive, of datagrams that are sent at once."""
    process: Any = lab.popen('operator', [sys.executable, '-c', RECEIVE], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b'bound\n'
    lab.run('robot', [sys.executable, '-c', SEND, ADDRESSES['operator'], str(tos)], check=True)
    found: List[int] = json.loads(process.communicate()[0])
    return found


def test_datagrams_that_wait_in_the_queue_are_marked(lab: Lab) -> None:
    # 8 ms each: those from the fourth on wait for longer than 20 ms
    lab.set(robot={'rate': 1e6, 'queue': 1.0, 'ecn_threshold': 0.02})
    assert heard(lab, 0x8a) == [0x8a] * 3 + [0x8b] * (COUNT - 3)
    assert lab.counts()['robot']['marked'] == COUNT - 3
    assert heard(lab, 0x88) == [0x88] * COUNT       # its sender would not see marks
    assert lab.counts()['robot']['marked'] == COUNT - 3
