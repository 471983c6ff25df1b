# SPDX-License-Identifier: BSD-3-Clause
from types import SimpleNamespace

from smokebot_udp.nodes.stale import stale, words


def stream(last_shown, steady=True):
    return SimpleNamespace(last_shown=last_shown, STEADY=steady)


def sent(enabled=True, rate=10.0):
    return SimpleNamespace(enabled=enabled, rate=rate)


STREAMS = {'lidar': stream(94.0), 'scan': stream(99.9), 'map': stream(5.0, steady=False), 'gas': stream(None)}


def test_what_no_longer_comes_is_stale():
    assert stale(STREAMS, {}, 2.0, 100.0) == ({'lidar': 6.0}, 2)
    assert stale(STREAMS, {}, 10.0, 100.0) == ({}, 2)


def test_what_the_robot_does_not_send_is_not():
    assert stale(STREAMS, {'lidar': sent(enabled=False)}, 2.0, 100.0) == ({}, 1)


def test_what_is_sent_rarely_may_be_older():
    assert stale(STREAMS, {'lidar': sent(rate=0.4)}, 2.0, 100.0) == ({}, 2)
    assert stale(STREAMS, {'lidar': sent(rate=0.6)}, 2.0, 100.0) == ({'lidar': 6.0}, 2)


def test_words():
    assert words({}, 3) == ''
    assert words({'lidar': 6.4, 'scan': 2.2}, 3) == 'NO DATA 6 s: lidar, scan'
    assert words({'lidar': 6.4, 'scan': 7.2}, 2) == 'NO DATA 7 s'
