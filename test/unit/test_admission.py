# SPDX-License-Identifier: BSD-3-Clause
"""Which requests a publisher grants."""
import pytest

from smokebot_udp.budget import Budget
from smokebot_udp.udpros.admission import (
    MAX_CONNECTIONS,
    MAX_PER_HOST,
    MIN_REQUESTED_SIZE,
    SETTLED,
    Claim,
    check_address,
    check_room,
    check_size,
    has_ended,
    is_living,
)
from smokebot_udp.udpros.negotiation import Refused


@pytest.mark.parametrize('address', ['224.0.0.1', '239.255.255.250', '255.255.255.255', '0.0.0.0', '240.0.0.1'])
def test_addresses_of_no_host(address) -> None:
    with pytest.raises(Refused, match='not the address of a host') as refusal:
        check_address(address)
    assert refusal.value.reason == 'address'


@pytest.mark.parametrize('address', ['127.0.0.1', '10.0.0.7', '192.168.1.20', '169.254.3.4', '8.8.8.8'])
def test_addresses_of_hosts(address) -> None:
    check_address(address)


@pytest.mark.parametrize(('requested', 'ours', 'accepted'), [
    (1500, 1472, True), (1472, 1472, True), (1392, 1472, True), (MIN_REQUESTED_SIZE, 1472, True),
    (MIN_REQUESTED_SIZE - 1, 1472, False), (64, 1472, False), (64, 64, True), (300, 300, True), (299, 300, False)])
def test_datagrams_that_multiply_the_work_are_refused(requested, ours, accepted) -> None:
    if accepted:
        check_size(requested, ours)
        return
    with pytest.raises(Refused, match='max_datagram_size is %d' % requested) as refusal:
        check_size(requested, ours)
    assert refusal.value.reason == 'datagram size'


def test_connections_of_a_host_and_in_all_are_bounded() -> None:
    of_host = [('/a', 'host')] * MAX_PER_HOST
    check_room(('/a', 'host'), of_host[1:])
    check_room(('/a', 'other'), of_host)
    check_room(('/b', 'host'), of_host)
    with pytest.raises(Refused, match='to host already') as refusal:
        check_room(('/a', 'host'), of_host)
    assert refusal.value.reason == 'connections of a host'
    many = [('/%d' % number, 'host') for number in range(MAX_CONNECTIONS)]
    check_room(('/a', 'host'), many[1:])
    with pytest.raises(Refused, match='%d connections already' % MAX_CONNECTIONS) as refusal:
        check_room(('/a', 'host'), many)
    assert refusal.value.reason == 'connections'


@pytest.mark.parametrize(('claim', 'ports', 'living', 'ended'), [
    (Claim(5000, True, 100.0), {5000}, True, False),
    (Claim(5000, True, 100.0), {5001}, False, True),            # the subscriber was restarted, or never asked
    (Claim(5000, True, 100.0), set(), False, True),
    (Claim(5000, False, 100.0), {5000}, False, True),           # its port, on a stranger's host
    (Claim(5000, True, SETTLED / 2), {5001}, False, False),     # it may not have the answer yet
    (Claim(5000, True, 100.0), None, False, False),             # nothing is known
])
def test_only_the_subscriber_knows_what_it_has(claim, ports, living, ended) -> None:
    assert (is_living(claim, ports), has_ended(claim, ports)) == (living, ended)


def test_a_budget_is_spent_and_comes_back() -> None:
    budget = Budget(3, 10.0)
    assert [budget.take(100.0) for _ in range(5)] == [True, True, True, False, False]
    assert [budget.take(now) for now in (109.0, 110.5, 111.0, 120.5)] == [False, True, False, True]
    assert [budget.take(1000.0) for _ in range(4)] == [True, True, True, False]
