# SPDX-License-Identifier: BSD-3-Clause
"""The statuses of the link as a whole and of the two machines' clocks."""
from typing import Dict, Optional

from ..units import MBIT
from .clock_offset import ClockEstimate
from .stats import LinkStats
from .status import OK, OPERATOR, ROBOT, WARN, Status, Verdict

HOLE = 'datagrams above %d bytes do not pass'


def link_status(stats: LinkStats) -> Status:
    """The status of the link, on the robot's side."""
    verdict, hole = Verdict(), {} if stats.longest is None else {'longest datagram [byte]': stats.longest}
    if stats.adaptive and stats.timeout:
        verdict.add(WARN, stats.state)
    if stats.longest is not None:
        verdict.add(WARN, HOLE % stats.longest)
    return Status('link control', verdict.level, str(verdict) or 'fine', {
        'side': ROBOT, 'state': stats.state, 'rate [Mbit/s]': (stats.rate or 0.0) / MBIT,
        'sent [Mbit/s]': stats.sent / MBIT, 'wanted [Mbit/s]': stats.wanted / MBIT,
        'capacity [Mbit/s]': stats.capacity / MBIT, 'loss [%]': 100 * stats.loss,
        'queue delay [ms]': 1e3 * stats.queue_delay, 'round trip [ms]': 1e3 * stats.round_trip,
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
    return Status('clock', level, message, {'side': OPERATOR, **values, **counts})
