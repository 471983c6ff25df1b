# SPDX-License-Identifier: BSD-3-Clause
import socket
from typing import List

from smokebot_udp.link import interfaces
from smokebot_udp.link.interfaces import PERIOD, Interfaces


def test_without_a_name_the_kernel_decides() -> None:
    reported: List[str] = []
    found = Interfaces(['', ''], reported.append)
    found.poll(0.0)
    assert (found.index(''), found.problem, reported) == (0, None, [])


def test_they_come_and_go(monkeypatch) -> None:
    there = {'wlan0': 3, 'wwan0': 7}
    monkeypatch.setattr(interfaces, 'index_of', there.get)
    reported: List[str] = []
    found = Interfaces(['wwan0', 'wlan0'], reported.append)

    def indices() -> List[object]:
        return [found.index(name) for name in ('wwan0', 'wlan0')]
    found.poll(0.0)
    assert (indices(), reported) == ([7, 3], [])
    del there['wwan0']
    found.poll(PERIOD / 2)
    assert indices() == [7, 3]
    for now in (PERIOD, 2 * PERIOD):
        found.poll(now)
        assert indices() == [None, 3] and found.problem is None
        assert reported == ["robot: this machine has no interface 'wwan0' now"]
    del there['wlan0']
    found.poll(3 * PERIOD)
    assert found.problem == 'this machine has no interface wwan0 or wlan0 now'
    there['wwan0'] = 9      # plugged in again
    found.poll(4 * PERIOD)
    assert indices() == [9, None] and found.problem is None


def test_the_interfaces_of_this_machine() -> None:
    reported: List[str] = []
    names = ['lo', 'none\0', 'much_longer_than_fits']
    found = Interfaces(names, reported.append)
    found.poll(0.0)
    assert [found.index(name) for name in names] == [socket.if_nametoindex('lo'), None, None] and len(reported) == 2
