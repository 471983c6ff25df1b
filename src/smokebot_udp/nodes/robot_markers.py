# SPDX-License-Identifier: BSD-3-Clause
"""Publishes the robot's footprint and heading, and the path that it has driven, for display in 3D."""
import threading
from typing import Any, List

import rospy
from geometry_msgs.msg import Point, PoseStamped, Vector3
from nav_msgs.msg import Odometry, Path
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ..codecs.display.driven_path import DrivenPath
from ..mission.footprint import DEFAULT_FOOTPRINT, Footprint, read_footprint
from ..streams.frame_prefix import with_prefix
from .common import Parameters, operator_topic
from .logging import log_error
from .opened import Part
from .worker import PeriodicWorker

PERIOD = 1.0
"""The path is published as often as it changes, but not more often than this [s]."""

REPEAT_PERIOD = 2.0
"""Markers are published again after this time: rviz hides one that came before the first transform of its frame, and
does not show it later [s]."""

COLOUR = ColorRGBA(0.2, 1.0, 0.3, 1.0)
LINE_WIDTH, ARROW_WIDTH, ARROW_REACH = 0.05, 0.14, 0.4
"""The arrow begins at the robot's origin and reaches so far beyond the footprint [m]."""


class RobotMarkers(Part):
    """Lives as long as its node.

    :param parameters: footprint, footprint_topic, path_topic, odom_topic, base_frame and frame_prefix of
        parameters.OPERATOR_RECEIVER
    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__()
        self._path, self._header, self._changed = DrivenPath(), Header(), False
        self._lock = threading.Lock()
        self._footprints, self._paths = (
            self._opened.topic(rospy.Publisher(operator_topic(parameters[name]), class_, queue_size=1, latch=True))
            for name, class_ in (('footprint_topic', MarkerArray), ('path_topic', Path)))
        self._footprint = MarkerArray(outline(
            self._outline(parameters), with_prefix(parameters['base_frame'], parameters['frame_prefix'])))
        self._opened.started(PeriodicWorker('footprint', self._repeat, log_error('footprint'), REPEAT_PERIOD))
        self._opened.started(PeriodicWorker('driven path', self._publish, log_error('driven path'), PERIOD))
        self._opened.topic(rospy.Subscriber(operator_topic(parameters['odom_topic']), Odometry, self._take,
                                            queue_size=1))

    @staticmethod
    def _outline(parameters: Parameters) -> Footprint:
        try:
            return read_footprint(parameters['footprint'] or DEFAULT_FOOTPRINT)
        except ValueError as error:
            parameters.report('%s: the default is used' % error)
            return read_footprint(DEFAULT_FOOTPRINT)

    def _take(self, odometry: Any) -> None:
        position = odometry.pose.pose.position
        with self._lock:
            if self._path.add(odometry.header.frame_id, (position.x, position.y, position.z)):
                self._header, self._changed = odometry.header, True

    def _repeat(self) -> None:
        if not rospy.is_shutdown():
            self._footprints.publish(self._footprint)

    def _publish(self) -> None:
        with self._lock:
            if not self._changed:
                return
            positions, source, self._changed = self._path.positions, self._header, False
        # stamp 0: the latest transform; rviz, started later, has none of the odometry's time. rospy writes into it
        header = Header(frame_id=source.frame_id)
        path = Path(header=header, poses=[PoseStamped(header=header) for _ in positions])
        for pose, position in zip(path.poses, positions):
            pose.pose.position, pose.pose.orientation.w = Point(*position), 1.0
        if not rospy.is_shutdown():
            self._paths.publish(path)


def outline(footprint: Footprint, frame: str) -> List[Any]:
    """The visualization_msgs/Markers of a footprint and of the heading; none where it has no corner.

    :param frame: of the robot; displays draw them there whenever it moves
    """
    if not footprint:
        return []
    corners = [Point(x, y, LINE_WIDTH) for x, y in (*footprint, footprint[0])]
    line = Marker(ns='footprint', type=Marker.LINE_STRIP, points=corners, scale=Vector3(LINE_WIDTH, 0.0, 0.0))
    front = Point(max(x for x, _ in footprint) + ARROW_REACH, 0.0, LINE_WIDTH)
    arrow = Marker(ns='heading', type=Marker.ARROW, points=[Point(0.0, 0.0, LINE_WIDTH), front],
                   scale=Vector3(ARROW_WIDTH / 2, ARROW_WIDTH, 2 * ARROW_WIDTH))
    for marker in (line, arrow):
        marker.header.frame_id, marker.frame_locked = frame, True   # stamp 0: the latest transform
        marker.color, marker.pose.orientation.w = COLOUR, 1.0
    return [line, arrow]
