# SPDX-License-Identifier: BSD-3-Clause
"""Whether a master knows a node."""
from smokebot_udp.udpros.master import Acquaintance, Identity, Registration

OURS, OTHER = 'http://here:1/', 'http://there:2/'
OLD, NEW = Identity(10, 'a'), Identity(10, 'b')


def test_the_master_of_the_nodes_start_knows_it() -> None:
    acquaintance = Acquaintance()
    assert not acquaintance.is_lost(OLD, OURS, OURS)
    assert not acquaintance.is_lost(OLD, OURS, OURS)


def test_a_master_that_does_not_know_the_node_is_lost_until_it_is_registered() -> None:
    acquaintance = Acquaintance()
    assert not acquaintance.is_lost(OLD, OURS, OURS)
    assert acquaintance.is_lost(NEW, None, OURS)
    assert acquaintance.is_lost(NEW, OURS, OURS)    # a part has been registered
    acquaintance.registered(NEW)
    assert not acquaintance.is_lost(NEW, OURS, OURS)
    assert acquaintance.is_lost(NEW, None, OURS)    # somebody removed it


def test_a_master_that_answers_after_an_outage_may_be_new() -> None:
    acquaintance = Acquaintance()
    acquaintance.missed()
    assert acquaintance.is_lost(NEW, OURS, OURS)        # as far as it knows, only a part is registered
    acquaintance.registered(NEW)
    acquaintance.missed()
    assert not acquaintance.is_lost(NEW, OURS, OURS)


def test_another_node_of_the_name_is_left_alone() -> None:
    acquaintance = Acquaintance()
    assert not acquaintance.is_lost(OLD, OURS, OURS)
    assert not acquaintance.is_lost(OLD, OTHER, OURS)
    assert not acquaintance.is_lost(NEW, OTHER, OURS)


def test_the_masters_calls() -> None:
    topic, parameter = Registration('/t', 'std_msgs/Header', 'pub'), Registration('/n', '', 'param')
    assert topic.call('/n', OURS) == {
        'methodName': 'registerPublisher', 'params': ['/n', '/t', 'std_msgs/Header', OURS]}
    assert parameter.call('/n', OURS) == {'methodName': 'subscribeParam', 'params': ['/n', OURS, '/n']}
