# SPDX-License-Identifier: BSD-3-Clause
"""The status of refused requests."""
from smokebot_udp.monitoring.request_status import RequestMonitor
from smokebot_udp.monitoring.status import OK, ROBOT, WARN


def test_requests_that_are_refused_are_a_warning_for_a_while() -> None:
    monitor = RequestMonitor(ROBOT)
    assert monitor.update({}, 0.0)[1:3] == (OK, 'fine')
    status = monitor.update({'address': 2, 'datagram size': 1}, 1.0)
    assert (status.level, status.message) == (WARN, 'requests refused: 2 address, 1 datagram size')
    assert status.values == {
        'side': 'robot', 'refused requests': 3, 'refused, address': 2, 'refused, datagram size': 1}
    for now in range(2, 20):
        status = monitor.update({'address': 2, 'datagram size': 1}, float(now))
    assert (status.level, status.values['refused requests']) == (OK, 3)
    assert monitor.update({'address': 3, 'datagram size': 1}, 20.0).message == 'requests refused: 1 address'
