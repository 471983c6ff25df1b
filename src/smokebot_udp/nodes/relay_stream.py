# SPDX-License-Identifier: BSD-3-Clause
"""The runner of relays on the robot: short messages leave at once, long ones whole and with a share of the link."""
from typing import Any, Dict, Optional, Sequence

from .. import traffic
from ..congestion.controller import Demand
from ..mission.settings import Settings
from ..monitoring.stats import StreamStats
from ..streams.relay.encoder import RelayEncoder
from ..udpros.frame import Frame
from .robot_stream import RobotStream

MIN_SHARED_RATE = 0.2
"""With max_share, however slow the link is [Hz]."""


class RelayStream(RobotStream):
    """Sends messages before everything that waits, while its encoder is `protected`."""
    encoder: RelayEncoder
    WHOLE, REPLACES = True, False   # what is left is awaited before the message is encoded

    def limits(self, granted: Optional[Dict[str, Any]], decimation: float, capacity: float
               ) -> Optional[Dict[str, Any]]:
        if not self.encoder.protected:
            return granted
        requested = self.settings.current.requested
        limits = {} if decimation >= 1 else {
            setting: max(decimation * requested[setting], min(least, requested[setting]))
            for setting, least in self.encoder.LEAST.items()}
        share, rate = requested['max_share'], limits.get('rate', requested['rate'])
        if share < 1 and capacity and self.encoder.message_size:
            size = self.link.expansion * self.encoder.message_size
            limits['rate'] = min(rate, max(share * capacity / size, MIN_SHARED_RATE))
        return limits

    def demand(self, now: float) -> Optional[Demand]:
        found = super().demand(now)     # it measures the source
        return None if self.encoder.protected else found

    def stats(self) -> StreamStats:
        stats = super().stats()
        stats.dropped['replaced'] += self.encoder.replaced
        return stats

    def _send_message(self, message: Any, arrival: int, settings: Settings) -> None:
        if not self.encoder.protected:
            self.link.outbox.await_rest(self.name, True)
        super()._send_message(message, arrival, settings)

    def _send(self, frames: Sequence[Frame]) -> int:
        """Each frame is a message while they are protected."""
        if not self.encoder.protected:
            return super()._send(frames)
        self._send_at_once(frames)
        return len(frames)

    @property
    def _datagram_size(self) -> int:
        # short messages need no second datagram, however slow the link is
        return self.link.transport.room if self.encoder.protected else super()._datagram_size

    @property
    def _tos(self) -> int:
        return traffic.EXPEDITED | traffic.ECT if self.encoder.protected else super()._tos
