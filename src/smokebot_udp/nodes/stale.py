# SPDX-License-Identifier: BSD-3-Clause
"""What is old must not look live in rviz's 3D view: a text while streams are stale, and clouds and scans that are no
longer true are cleared.

Images have annotated views that show their own age, see streams.image.view.
"""
import time
from typing import Any, Callable, Dict, Mapping

import rospy
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from ..monitoring.staleness import Freshness, outdated_streams, stale_streams, stale_text
from .logging import log_error
from .opened import Part
from .worker import PeriodicWorker

PERIOD = 0.5
"""[s]"""

FULL_SIZE = 16
"""Longer texts are smaller, so that operator.rviz shows all of them [letters]."""


class StaleStreams(Part):
    """Publishes a text above the robot, and clears streams.

    :param streams: {name: OperatorStream}, started
    :param sent: f() -> {name: StreamStatus}, the robot's last report of what it sends
    :param topic: of the visualization_msgs/Marker
    :param frame: of the robot
    :param after: shortest silence that makes a stream stale [s]
    :param clears: whether clouds and scans are cleared that are stale, or not sent any more
    """

    def __init__(self, streams: Mapping[str, Any], sent: Callable[[], Dict[str, Any]], topic: str, frame: str,
                 after: float, clears: bool) -> None:
        super().__init__()
        self._streams, self._sent, self._frame, self._after = streams, sent, frame, after
        self._clears = clears
        self._shown = ''
        self._publisher = self._opened.topic(rospy.Publisher(topic, Marker, queue_size=1, latch=True))
        self._opened.started(PeriodicWorker('stale', self._update, log_error('stale streams'), PERIOD))

    def _update(self) -> None:
        sent = self._sent()
        streams = {name: _freshness(stream, sent.get(name)) for name, stream in self._streams.items()}
        now = time.monotonic()
        if self._clears:
            for name, shown in outdated_streams(streams, self._after, now).items():
                self._streams[name].clear(shown, now)
        text = stale_text(*stale_streams(streams, self._after, now))
        if text != self._shown and not rospy.is_shutdown():    # it counts seconds: rviz gets it again and again
            self._publisher.publish(self._marker(text))
            self._shown = text

    def _marker(self, text: str) -> Any:
        marker = Marker(ns='stale', type=Marker.TEXT_VIEW_FACING, action=Marker.ADD if text else Marker.DELETE,
                        text=text, color=ColorRGBA(1.0, 0.1, 0.1, 1.0), frame_locked=True)
        marker.header.frame_id = self._frame    # stamp 0: the latest transform, however old
        marker.pose.position.z, marker.pose.orientation.w = 1.5, 1.0
        marker.scale.z = 0.5 * min(1.0, FULL_SIZE / max(len(text), 1))
        return marker


def _freshness(stream: Any, sent: Any) -> Freshness:
    if sent is None:
        return Freshness(stream.last_shown, stream.assembler.STEADY, interval=stream.interval)
    granted = {one.name: one.value for one in sent.granted}
    return Freshness(stream.last_shown, stream.assembler.STEADY, sent.enabled, granted.get('rate', sent.rate),
                     stream.interval)
