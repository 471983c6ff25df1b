# SPDX-License-Identifier: BSD-3-Clause
"""When the nodes of subscribers are asked whether they still have their connections."""
from smokebot_udp.udpros.presence import HURRIED_PERIOD, MAX_UNANSWERED, PERIOD, Node, Presence

DESK = Node('10.0.0.2', '/desk', 'http://desk:1/')
VIEWER = Node('10.0.0.2', '/viewer', 'http://desk:2/')
TABLET = Node('10.0.0.3', '/tablet', None)


def test_a_node_is_asked_once_a_period() -> None:
    presence = Presence()
    asked = [now for now in range(1000) if presence.due({DESK: 2}, now)]
    first = round(HURRIED_PERIOD)       # it may have ended before it was seen
    assert asked == list(range(first, 1000, round(PERIOD)))


def test_a_new_node_is_not_asked_at_once() -> None:
    presence = Presence()
    presence.due({DESK: 2}, 0.0)
    assert not presence.due({DESK: 2, TABLET: 2}, 1.0)
    assert presence.due({DESK: 2, TABLET: 2}, HURRIED_PERIOD) == [DESK]
    assert presence.due({DESK: 2, TABLET: 2}, HURRIED_PERIOD + 1) == [TABLET]


def test_a_request_hurries_the_nodes_of_its_host() -> None:
    presence = Presence()
    presence.due({DESK: 2, VIEWER: 2, TABLET: 2}, -HURRIED_PERIOD)
    presence.due({DESK: 2, VIEWER: 2, TABLET: 2}, 0.0)
    presence.requested('10.0.0.2', 1.0)
    assert not presence.due({DESK: 2, VIEWER: 2, TABLET: 2}, HURRIED_PERIOD - 0.1)
    assert set(presence.due({DESK: 2, VIEWER: 2, TABLET: 2}, HURRIED_PERIOD)) == {DESK, VIEWER}
    assert not presence.due({DESK: 2, VIEWER: 2, TABLET: 2}, 2 * HURRIED_PERIOD)


def test_a_connection_that_has_ended_makes_the_others_of_its_node_doubtful() -> None:
    presence = Presence()
    for now in (-HURRIED_PERIOD, 0.0):
        presence.due({DESK: 5, TABLET: 5}, now)
    assert presence.due({DESK: 5, TABLET: 5}, 30.0) == []
    assert presence.due({DESK: 4, TABLET: 6}, 31.0) == [DESK]
    assert presence.due({DESK: 3, TABLET: 6}, 32.0) == []       # it was asked a moment ago
    assert presence.due({DESK: 3, TABLET: 6}, 31.0 + HURRIED_PERIOD) == [DESK]
    assert presence.due({DESK: 3, TABLET: 6}, 31.0 + 2 * HURRIED_PERIOD) == []


def test_many_requests_cost_little() -> None:
    presence, asked = Presence(), 0
    for now in range(1000):
        presence.requested('10.0.0.2', now)
        asked += len(presence.due({DESK: 2}, now))
    assert asked <= 1000 / HURRIED_PERIOD


def test_an_outage_ends_nothing_before_long() -> None:
    presence = Presence()
    presence.due({DESK: 2}, 0.0)
    presence.answered(DESK, 100.0)
    assert not presence.is_lost(DESK, 99.0 + MAX_UNANSWERED)
    assert presence.is_lost(DESK, 100.0 + MAX_UNANSWERED)


def test_a_node_without_connections_is_forgotten() -> None:
    presence = Presence()
    presence.due({DESK: 2}, 0.0)
    presence.due({}, 1.0)
    presence.due({DESK: 2}, MAX_UNANSWERED)
    assert not presence.is_lost(DESK, MAX_UNANSWERED + 1)
    assert not presence.is_lost(VIEWER, MAX_UNANSWERED)
