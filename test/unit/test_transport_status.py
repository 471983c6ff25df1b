# SPDX-License-Identifier: BSD-3-Clause
from smokebot_udp.monitoring.status import OK, OPERATOR, ROBOT, WARN
from smokebot_udp.monitoring.transport_status import transport_status
from smokebot_udp.transport import PeerStats, TransportStats


def test_peers_and_drops_are_listed() -> None:
    peers = [PeerStats('/operator_receiver@desk', ('10.0.0.9', 40000), 0.2, 0.0124),
             PeerStats('/ugv1/operator_receiver@truck', ('10.0.0.8', 40001), 12.4, None)]
    status = transport_status(TransportStats(True, peers, 3, {'wrong tag': 2, 'replayed': 5}, None), ROBOT)
    assert (status.name, status.level, status.message) == ('link transport', OK, 'fine')
    assert status.values == {
        'side': 'robot', 'sealed': 'yes',
        'connected to': '/operator_receiver@desk at 10.0.0.9:40000 (round trip 12 ms); '
                        '/ugv1/operator_receiver@truck at 10.0.0.8:40001 (silent for 12 s)',
        'handshakes': 3, 'dropped': 7, 'dropped, replayed': 5, 'dropped, wrong tag': 2}


def test_a_problem_is_a_warning() -> None:
    remarked = transport_status(TransportStats(True, [], 0, {}, None, ['the buffer is short']), OPERATOR)
    assert (remarked.level, remarked.message) == (WARN, 'the buffer is short')
    status = transport_status(TransportStats(False, [], 0, {}, '10.0.0.7:17001 does not answer'), OPERATOR)
    assert (status.level, status.message) == (WARN, '10.0.0.7:17001 does not answer')
    assert status.values == {'side': 'operator', 'sealed': 'no: anybody on the network can watch',
                             'connected to': 'nobody', 'handshakes': 0, 'dropped': 0}
