# SPDX-License-Identifier: BSD-3-Clause
"""The status of a transport with handshakes, on either side."""
from ..transport import PeerStats, TransportStats
from .status import OK, WARN, Status, by_reason


def transport_status(stats: TransportStats, side: str) -> Status:
    """The status of a transport.

    :param side: ROBOT or OPERATOR
    """
    wrong = '; '.join(([stats.problem] if stats.problem else []) + list(stats.remarks))
    return Status('link transport', WARN if wrong else OK, wrong or 'fine', {
        'side': side, 'sealed': 'yes' if stats.sealed else 'no: anybody on the network can watch',
        'connected to': '; '.join(map(_peer, stats.peers)) or 'nobody', 'handshakes': stats.handshakes,
        'dropped': sum(stats.dropped.values()), **by_reason('dropped', dict(stats.dropped))})


def _peer(peer: PeerStats) -> str:
    """A peer in words: only what is known of it."""
    parts = ['silent for %.0f s' % peer.silence] if peer.silence >= 1 else []
    if peer.round_trip is not None:
        parts.append('round trip %.0f ms' % (1e3 * peer.round_trip))
    return '%s at %s:%d%s' % (peer.name, *peer.address, ' (%s)' % ', '.join(parts) if parts else '')
