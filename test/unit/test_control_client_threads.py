# SPDX-License-Identifier: BSD-3-Clause
import sys
import threading
from typing import Iterator

import pytest

from smokebot_udp.teleop.control_client import ControlClient
from smokebot_udp.teleop.records import PeerStatus, Status

SESSION, ROBOT = 7, 9


@pytest.fixture(autouse=True)
def threads_that_switch_often() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def test_the_loss_may_be_read_while_statuses_come() -> None:
    """By the threads of command streams, without a lock."""
    client, ended = ControlClient(SESSION), threading.Event()
    own = PeerStatus(SESSION, 'a', 1.0, 0.0, loss=0.25)

    def receive() -> None:
        for number in range(1, 100000):
            client.receive(Status(ROBOT, float(number), operators=(own,) if number % 2 else ()), 1.0)
        ended.set()
    thread = threading.Thread(target=receive)
    thread.start()
    while not ended.is_set():
        assert client.loss in (None, 0.25)
    thread.join()
