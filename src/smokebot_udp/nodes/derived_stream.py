# SPDX-License-Identifier: BSD-3-Clause
"""The runner of streams whose messages are made on the robot, of others: they are published there, too.

However slow the link is, they are published at the requested rate: their rate is limited twice.
"""
import time
from typing import Any, Callable, Mapping, Tuple

import rospy

from ..frame_names import frame_name
from ..mission.settings import Settings
from ..streams.rate import RateLimiter
from ..streams.virtual_scan.encoder import VirtualScanEncoder
from .robot_stream import RobotLink, RobotStream


class DerivedStream(RobotStream):
    """Publishes and sends the scans of clouds.

    :param local_publisher: makes their publisher, as rospy.Publisher
    """
    encoder: VirtualScanEncoder
    REPLACES = False

    def __init__(self, name: str, settings: Mapping[str, Any], encoder: VirtualScanEncoder, link: RobotLink,
                 subscriber: Callable[..., Any] = rospy.Subscriber,
                 local_publisher: Callable[..., Any] = rospy.Publisher) -> None:
        super().__init__(name, settings, encoder, link, subscriber)
        self._make_local_publisher = local_publisher
        self._local_publisher: Any = None     # made by start()
        self._limiter = RateLimiter(self.settings.current['rate'])
        self._derived: Tuple[Any, str] = None, ''      # stamp and frame of the last message

    def start(self) -> None:
        topic = self.settings.current['scan_topic'] or self.name
        self._local_publisher = self._make_local_publisher(topic, self.encoder.DERIVED, queue_size=2)
        super().start()

    def close(self) -> None:
        super().close()
        if self._local_publisher is not None:
            self._local_publisher.unregister()

    @property
    def _encodes(self) -> bool:
        return super()._encodes or self._local_publisher.get_num_connections() > 0

    def _encoding_rate(self, settings: Settings) -> float:
        rate: float = settings.requested['rate']
        return rate

    def _send_message(self, message: Any, arrival: int, settings: Settings) -> None:
        began = time.monotonic()
        message = self.encoder.derive(message, settings)
        self._busy += time.monotonic() - began
        self._local_publisher.publish(message)
        if self.wanted and self._may_send(settings):
            super()._send_message(message, self._identify_derived(message.header, arrival), settings)

    def _may_send(self, settings: Settings) -> bool:
        """Whether a message is sent: it is published more often where the link is slow."""
        now = time.monotonic()
        self._limiter.rate = self._schedule.active(now) * settings['rate']
        if self._limiter.due > now:
            return False
        self._limiter.take(now)
        return True

    def _identify_derived(self, header: Any, arrival: int) -> int:
        """The arrival that crosses with a message: sources of different frames may become one [ns]."""
        before, self._derived = self._derived, (header.stamp, frame_name(header.frame_id))
        return arrival or (rospy.Time.now().to_nsec() if before == self._derived else 0)
