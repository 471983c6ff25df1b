# SPDX-License-Identifier: BSD-3-Clause
from smokebot_udp.monitoring.staleness import Freshness, outdated_streams, stale_streams, stale_text

STREAMS = {'lidar': Freshness(94.0), 'scan': Freshness(99.9), 'map': Freshness(5.0, steady=False),
           'gas': Freshness(None)}


def test_streams_without_new_messages_are_stale() -> None:
    assert stale_streams(STREAMS, 2.0, 100.0) == ({'lidar': 6.0}, 2)
    assert stale_streams(STREAMS, 10.0, 100.0) == ({}, 2)


def test_streams_that_the_robot_does_not_send_are_not_stale() -> None:
    streams = {**STREAMS, 'lidar': Freshness(94.0, enabled=False, rate=10.0)}
    assert stale_streams(streams, 2.0, 100.0) == ({}, 1)


def test_slow_streams_may_be_older() -> None:
    assert stale_streams({**STREAMS, 'lidar': Freshness(94.0, rate=0.4)}, 2.0, 100.0) == ({}, 2)
    assert stale_streams({**STREAMS, 'lidar': Freshness(94.0, rate=0.6)}, 2.0, 100.0) == ({'lidar': 6.0}, 2)


def test_a_source_that_is_slower_than_its_maximum_rate_may_be_older() -> None:
    """The battery publishes at 0.5 Hz, and its maximum rate is 1 Hz: the loss of one message is no fault."""
    streams = {'battery': Freshness(95.5, rate=1.0, interval=2.0)}
    assert stale_streams(streams, 2.0, 100.0) == ({}, 1)
    assert stale_streams(streams, 2.0, 102.0) == ({'battery': 6.5}, 1)


def test_stale_streams_and_those_that_the_robot_does_not_send_are_outdated() -> None:
    assert outdated_streams(STREAMS, 2.0, 100.0) == {'lidar': 94.0}
    streams = {**STREAMS, 'scan': Freshness(99.9, enabled=False), 'gas': Freshness(None, enabled=False),
               'map': Freshness(5.0, steady=False, enabled=False)}
    assert outdated_streams(streams, 10.0, 100.0) == {'scan': 99.9}


def test_the_text() -> None:
    assert stale_text({}, 3) == ''
    assert stale_text({'lidar': 6.4}, 3) == 'NO DATA 6 s: lidar'
    assert stale_text({'lidar': 6.4, 'scan': 2.2}, 3) == 'NO DATA 6 s: lidar +1'
    assert stale_text({'lidar': 6.4, 'scan': 7.2}, 2) == 'NO DATA 7 s'
