# SPDX-License-Identifier: BSD-3-Clause
"""What nodes say of their UDPROS connections."""
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.udpros.bus_info import BusEntry, receiving_ports, udpros_entries

ROSPY = [3, '/operator', 'o', 'UDPROS', '/a', True, 'UDPROS connection on port 40000 to [10.0.0.2:50000 on socket 12]']
ROSCPP = [7, '/viewer', 'o', 'UDPROS', '/a', 1, 'UDPROS connection on port 40001 to [laptop:50001 on socket 9]']
ROSCPP_INBOUND = [8, 'http://robot:4/', 'i', 'UDPROS', '/b', 1, 'UDPROS connection on port 50002 to []']
TCP = [9, '/rosout', 'o', 'TCPROS', '/rosout', True, 'TCPROS connection on port 45873 to [10.0.0.2:55000 on socket 8]']


def test_entries_of_both_client_libraries() -> None:
    assert udpros_entries([ROSPY, TCP, ROSCPP, ROSCPP_INBOUND]) == [
        BusEntry('/operator', 'o', '/a', 40000, '10.0.0.2', 50000),
        BusEntry('/viewer', 'o', '/a', 40001, 'laptop', 50001),
        BusEntry('http://robot:4/', 'i', '/b', 50002, None, None)]


def test_what_a_node_does_not_say_is_unknown() -> None:
    unknown = BusEntry('/operator', 'o', '/a', None, None, None)
    for text in ([], [True], [True, 7], [True, 'UDPROS'], [True, 'connected to [10.0.0.2:50000 on socket 12]']):
        assert udpros_entries([ROSPY[:5] + text]) == [unknown]


def test_ports_on_which_a_topic_is_received() -> None:
    entries = udpros_entries([ROSPY, TCP, ROSCPP, ROSCPP_INBOUND])
    assert receiving_ports(entries, '/b') == {50002}
    assert receiving_ports(entries, '/a') == receiving_ports([], '/b') == frozenset()


def test_a_node_that_does_not_say_its_ports_may_have_any() -> None:
    assert receiving_ports(None, '/b') is None
    assert receiving_ports(udpros_entries([ROSCPP_INBOUND, ROSCPP_INBOUND[:5]]), '/b') is None


def test_malformed_entries_are_left_out() -> None:
    assert udpros_entries([[], 7, ROSPY[:4], [3, 7, 'o', 'UDPROS', '/a'], None]) == []
    for bus in (None, 7, 'x', {}, [[]]):
        assert udpros_entries(bus) == []


SIMPLE = st.one_of(st.none(), st.integers(), st.text(), st.sampled_from(ROSPY))
ANYTHING: Any = st.recursive(SIMPLE, lambda inner: st.lists(inner, max_size=8))


@given(ANYTHING)
def test_whatever_comes_is_a_list(bus) -> None:
    assert isinstance(udpros_entries(bus), list)
