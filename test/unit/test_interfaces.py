# SPDX-License-Identifier: BSD-3-Clause
import socket
from typing import List

from smokebot_udp.link import interfaces
from smokebot_udp.link.interfaces import PERIOD, Interfaces


def test_without_names_the_kernel_decides() -> None:
    told: List[str] = []
    found = Interfaces([], told.append)
    found.poll(0.0)
    assert (list(found.indices), found.problem, told) == ([0], '', [])


def test_they_come_and_go(monkeypatch) -> None:
    there = {'wlan0': 3, 'wwan0': 7}

    def index_of(name: str) -> int:
        if name not in there:
            raise OSError('no such device')
        return there[name]
    monkeypatch.setattr(interfaces.socket, 'if_nametoindex', index_of)
    told: List[str] = []
    found = Interfaces(['wwan0', 'wlan0'], told.append)
    found.poll(0.0)
    assert (list(found.indices), told) == ([7, 3], [])
    del there['wwan0']
    found.poll(PERIOD / 2)
    assert list(found.indices) == [7, 3]
    for now in (PERIOD, 2 * PERIOD):
        found.poll(now)
        assert list(found.indices) == [3] and not found.problem
        assert told == ["interfaces: this machine has no interface 'wwan0' now"]
    del there['wlan0']
    found.poll(3 * PERIOD)
    assert not found.indices and found.problem == 'this machine has no interface wwan0 or wlan0 now'
    there['wwan0'] = 9      # plugged in again
    found.poll(4 * PERIOD)
    assert list(found.indices) == [9] and not found.problem


def test_the_interfaces_of_this_machine() -> None:
    told: List[str] = []
    found = Interfaces(['lo', 'none\0', 'much_longer_than_fits'], told.append)
    found.poll(0.0)
    assert list(found.indices) == [socket.if_nametoindex('lo')] and len(told) == 2
