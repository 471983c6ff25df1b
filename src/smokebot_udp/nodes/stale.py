# SPDX-License-Identifier: BSD-3-Clause
"""A word in rviz's 3D view while what it shows no longer comes: a cloud that stands still must not look live.

Pictures have views that tell it themselves, see streams.view.
"""
import time

import rospy
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from ..streams.rate import Repeater

PERIOD = 0.5
"""[s]"""

PATIENCE = 3.0
"""What is sent rarely is stale only after so many periods."""


def stale(streams, sent, after, now):
    """Which streams show what is old.

    Latched ones are never stale, nor those that the robot does not send, nor those that never came.

    :param streams: {name: OperatorStream}
    :param sent: {name: StreamStatus} that the robot told of
    :param after: [s]
    :param now: time.monotonic() [s]
    :return: {name: for how long nothing came [s]}, and how many could be stale
    """
    found, watched = {}, 0
    for name, stream in streams.items():
        status = sent.get(name)
        if not stream.STEADY or stream.last_shown is None or (status and not status.enabled):
            continue
        watched += 1
        silence = now - stream.last_shown
        if silence > max(after, PATIENCE / status.rate if status and status.rate else 0.0):
            found[name] = silence
    return found, watched


def words(silences, watched):
    """What the marker says of what `stale` returns; '' where there is nothing to tell."""
    if not silences:
        return ''
    return 'NO DATA %.0f s' % max(silences.values()) + (
        '' if len(silences) == watched else ': ' + ', '.join(silences))


class StaleMarker:
    """Publishes a text above the robot.

    :param streams: {name: OperatorStream}, started
    :param sent: f() -> {name: StreamStatus}
    :param topic: of the visualization_msgs/Marker
    :param frame: of the robot
    :param after: nothing came for so long [s]
    """

    def __init__(self, streams, sent, topic, frame, after):
        self._streams, self._sent, self._frame, self._after = streams, sent, frame, after
        self._told = ''
        self._publisher = rospy.Publisher(topic, Marker, queue_size=1, latch=True)
        self._repeater = Repeater('stale', self._look, self._report, PERIOD)
        self._repeater.start()

    def _look(self):
        text = words(*stale(self._streams, self._sent(), self._after, time.monotonic()))
        if text != self._told and not rospy.is_shutdown():
            self._publisher.publish(self._marker(text))
            self._told = text

    def _marker(self, text):
        marker = Marker(ns='stale', type=Marker.TEXT_VIEW_FACING, action=Marker.ADD if text else Marker.DELETE,
                        text=text, color=ColorRGBA(1.0, 0.1, 0.1, 1.0), frame_locked=True)
        marker.header.frame_id = self._frame    # at time 0: the latest transform there is, for it may be as old
        marker.pose.position.z, marker.pose.orientation.w, marker.scale.z = 2.0, 1.0, 1.5
        return marker

    def _report(self, error):
        if not rospy.is_shutdown():
            rospy.logerr_throttle_identical(60, 'the marker of stale data: %s' % error)

    def close(self):
        self._repeater.stop()
        self._publisher.unregister()
