# SPDX-License-Identifier: BSD-3-Clause
"""The statuses of a node as a whole: the link, the clocks, who drives, the transport, and refused requests."""
import re
from typing import Any, Dict, List, Mapping, Optional, Sequence, Union

from ..transport import PathStats, PeerStats, TransportStats
from ..units import MBIT
from .clock_offset import ClockEstimate
from .stats import LinkStats
from .status import ERROR, OK, WARN, Kind, Status, Verdict, by_reason, scaled
from .windows import Growths

PEER = re.compile(r'(?P<name>\S+) at (?P<host>[^\s:]+):(?P<port>\d{1,5})(?: by (?P<interface>[^\s;()]{1,15}))?'
                  r'(?: \((?P<unused>not used|commands only|beside)?(?:, )?(?:silent(?: for \d+ s)?)?(?:, )?'
                  r'(?:round trip (?P<round_trip>\d{1,9}) ms)?(?:, )?(?:[0-9.]{1,9} MB sent)?\))?', re.ASCII)
"""A peer in words, as `_peer` makes it."""

BY = 'by '
"""Before the name of a path, in the status of the link."""

HOLE = 'datagrams above %d bytes do not pass'


def path_text(sent: float, capacity: float, loss: float) -> str:
    """One of two paths, in words [Mbit/s, Mbit/s, 0..1]."""
    return '%.2f of %.2f Mbit/s sent, loss %.0f %%' % (sent, capacity, 100 * loss)


def link_status(stats: LinkStats) -> Status:
    """The status of the link, on the robot's side."""
    verdict, hole = Verdict(), {} if stats.longest is None else {'longest datagram [byte]': stats.longest}
    if stats.adaptive and stats.timeout or stats.only:
        verdict.add(WARN, stats.state)
    if stats.longest is not None:
        verdict.add(WARN, HOLE % stats.longest)
    return Status(Kind.LINK, 'link control', verdict.level, str(verdict) or 'fine', {
        'state': stats.state, 'rate [Mbit/s]': (stats.rate or 0.0) / MBIT,
        'sent [Mbit/s]': stats.sent / MBIT, 'wanted [Mbit/s]': stats.wanted / MBIT,
        'capacity [Mbit/s]': stats.capacity / MBIT, 'loss [%]': 100 * stats.loss,
        'queue delay [ms]': 1e3 * stats.queue_delay, 'round trip [ms]': 1e3 * stats.round_trip,
        **{BY + path.name: path_text(path.sent / MBIT, path.capacity / MBIT, path.loss) for path in stats.paths},
        **hole, **{'rate for %s [Mbit/s]' % operator: rate / MBIT for operator, rate in sorted(stats.slower.items())},
        **{'reports refused, ' + reason: count for reason, count in sorted(stats.refused_reports.items())}})


def clock_status(estimate: Optional[ClockEstimate], counts: Dict[str, int]) -> Status:
    """The status of the clocks, on the operator's side.

    :param counts: {event: how often it happened}
    """
    if estimate is None:
        level, message, values = WARN, "the offset of the robot's clock is unknown, and so are ages", {}
    else:
        level, message, values = OK, 'known', {
            '%s [ms]' % name: 1e3 * seconds for name, seconds in estimate._asdict().items()}
    return Status(Kind.CLOCK, 'clock', level, message, {**values, **counts})


def control_text(driver: str, estop: bool, operators: Sequence[str]) -> str:
    """Who drives, in words.

    :param driver: name; empty: nobody
    :param operators: names of all that are present
    """
    others = [name for name in operators if name != driver]
    return '%s%s%s' % ('EMERGENCY STOP; ' if estop else '', '%s drives' % driver if driver else 'nobody drives',
                       ', present: ' + ', '.join(others) if others else '')


def robot_control_status(driver: str, estop_by: Optional[str], operators: Sequence[str],
                         dropped: Mapping[str, int]) -> Status:
    """The status of the control, on the robot's side.

    :param estop_by: who engaged the emergency stop; None: it is not engaged
    :param dropped: {reason: requests that were refused}
    """
    estop = estop_by is not None
    message = 'emergency stop, engaged by %s' % estop_by if estop else 'fine'
    return Status(Kind.CONTROL, 'control', WARN if estop else OK, message, {
        'control': control_text(driver, estop, operators), 'driver': driver or 'nobody',
        'emergency stop': 'engaged' if estop else 'released', 'operators': ', '.join(operators) or 'none',
        **by_reason('dropped', dict(dropped))})


def operator_control_status(state: str, locked: bool, uncertainty: Optional[float], loss: Optional[float]) -> Status:
    """The status of the control, on the operator's side.

    :param state: in words, see OperatorControl
    :param locked: whether no command would leave now
    :param uncertainty: of the robot's clock [s]; None: it is unknown
    :param loss: ratio of this node's datagrams that do not reach the robot, 0..1; None: unknown
    """
    level = ERROR if uncertainty is None else WARN if locked else OK
    message = state if locked else "the robot's clock is not known" if level else 'fine'
    return Status(Kind.CONTROL, 'control', level, message, {
        'control': state, 'uncertainty of the robot\'s clock [ms]': scaled(uncertainty, 1e3),
        'loss to the robot [%]': scaled(loss, 100)})


def transport_status(stats: TransportStats) -> Status:
    """The status of a transport."""
    wrong = '; '.join(([stats.problem] if stats.problem else []) + list(stats.remarks))
    return Status(Kind.TRANSPORT, 'link transport', WARN if wrong else OK, wrong or 'fine', {
        'connected to': '; '.join(text for peer in stats.peers for text in _peer(peer)) or 'nobody',
        'handshakes': stats.handshakes,
        'dropped': sum(stats.dropped.values()), **by_reason('dropped', dict(stats.dropped))})


def _peer(peer: PeerStats) -> List[str]:
    """A peer in words, and its other addresses: only what is known of them."""
    return [_reached(peer, peer, '')] + [_reached(peer, path, path.use) for path in peer.others]


def _reached(peer: PeerStats, path: Union[PeerStats, PathStats], use: str) -> str:
    """:param use: of the path, unless it is the first one"""
    parts = [use] if use else []
    if path.silence >= 1:
        parts.append('silent for %.0f s' % path.silence)
    if path.round_trip is not None:
        parts.append('round trip %.0f ms' % (1e3 * path.round_trip))
    if len(peer.carried) > 1:
        parts.append('%.1f MB sent' % (peer.carried.get((path.address[0], path.interface), 0) / 1e6))
    return '%s at %s:%d%s%s' % (peer.name, *path.address, path.interface and ' by ' + path.interface,
                                ' (%s)' % ', '.join(parts) if parts else '')


def peers_in(text: str) -> List[Dict[str, Any]]:
    """The addresses of peers in the value `connected to` of a transport's status.

    :return: of each `name`, `host`, `port`, `interface`, which is empty where the kernel's routes decide, `round_trip`
        [s], which is None where it is unknown, and `used`: whether it is the first path
    """
    found = [PEER.fullmatch(one) for one in text.split('; ')]
    return [{'name': peer['name'], 'host': peer['host'], 'port': int(peer['port']),
             'interface': peer['interface'] or '',
             'round_trip': None if peer['round_trip'] is None else int(peer['round_trip']) / 1e3,
             'used': not peer['unused']}
            for peer in found if peer]


class RequestMonitor:
    """Follows the refused requests of a node."""

    def __init__(self) -> None:
        self._growths = Growths()

    def update(self, refused: Mapping[str, int], now: float) -> Status:
        """The status at a time [s].

        :param refused: {reason: requests refused until now}
        """
        recent = self._growths.update(refused, now)
        text = 'requests refused: ' + ', '.join('%d %s' % (count, reason) for reason, count in recent.items())
        return Status(Kind.REQUESTS, 'connection requests', WARN if recent else OK, text if recent else 'fine', {
            'refused requests': sum(refused.values()), **by_reason('refused', dict(refused))})
