# SPDX-License-Identifier: BSD-3-Clause
"""The status of the requests for UDPROS connections that a node refused: strangers, or peers that do not fit."""
from typing import Mapping

from .status import OK, WARN, Status, by_reason
from .windows import Growths


class RequestMonitor:
    """Follows the refused requests of a node.

    :param side: ROBOT or OPERATOR
    """

    def __init__(self, side: str) -> None:
        self._side = side
        self._growths = Growths()

    def update(self, refused: Mapping[str, int], now: float) -> Status:
        """The status at a time [s].

        :param refused: {reason: requests refused until now}
        """
        recent = self._growths.update(refused, now)
        text = 'requests refused: ' + ', '.join('%d %s' % (count, reason) for reason, count in recent.items())
        return Status('connection requests', WARN if recent else OK, text if recent else 'fine', {
            'side': self._side, 'refused requests': sum(refused.values()), **by_reason('refused', dict(refused))})
