# SPDX-License-Identifier: BSD-3-Clause
"""Passes the operators' reports of what they hold (msg/Held) on to the robot's streams."""
import collections
from typing import Any, Counter, Mapping, Optional

from ..limited_log import logwarn
from ..msg import Held
from ..streams.held import TOPIC, from_message
from ..transport import Transport
from .opened import Part
from .robot_stream import RobotStream


class HeldReports(Part):
    """Receives reports; lives as long as its node.

    :param streams: {name: RobotStream}
    """

    def __init__(self, streams: Mapping[str, RobotStream], transport: Transport) -> None:
        super().__init__()
        self.dropped: Counter[str] = collections.Counter()
        """{reason: count} of the reports that are not used."""
        self._streams = streams
        self._opened.topic(transport.subscriber(TOPIC, Held, self._receive, queue_size=20))

    def _receive(self, report: Any) -> None:
        """Take a report; the transport's thread."""
        reason = self._refused(report, report._connection_header['callerid'])
        if reason is not None:
            self.dropped[reason] += 1
            logwarn('a report of what an operator holds is not used', reason)

    def _refused(self, report: Any, sender: str) -> Optional[str]:
        """Pass a report on; the reason why it is not used, or None.

        :param sender: the node that it came from, and that it is about: it could keep tiles from another one otherwise
        """
        stream = self._streams.get(report.stream)
        if stream is None:
            return 'unknown stream'
        try:
            holding = from_message(report)
        except ValueError:
            return 'impossible'
        return None if stream.held(sender, holding) else 'unknown operator'
