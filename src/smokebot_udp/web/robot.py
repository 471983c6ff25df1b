# SPDX-License-Identifier: BSD-3-Clause
"""What this machine has of one robot, as frames and messages for browsers; it subscribes large topics only while a
browser shows them."""
import functools
import math
import threading
import time
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional, Set, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid, Path
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import BatteryState, CompressedImage, Image, LaserScan, PointCloud2
from std_msgs.msg import Float32, Float64, String
from tf2_msgs.msg import TFMessage

from .. import udpros
from ..arrays import Array
from ..codecs.display.overlay import EMERGENCY_STOP
from ..codecs.wire.points import as_points
from ..limited_log import logerr
from ..msg import CaptureProgress, LinkStatus, RobotStatus, ViewImage
from ..nodes.link_top import BoardListener
from ..nodes.logging import log_error
from ..nodes.opened import Part
from ..nodes.route import route_to
from ..nodes.view_publisher import PLAIN
from ..nodes.worker import PeriodicWorker
from ..numpy_messages import numpy_msg
from ..streams.config import Frames
from ..streams.frame_prefix import with_prefix
from ..streams.routes import UPDATES
from .catalogue import CLOUD, IMAGE, MAP, POINTS, Catalogue, Entry
from .frames import Frame, Kind
from .log_entries import LogEntries
from .paths import paths_of
from .pictures import Pictures, picture_of
from .relayed_images import RelayedColours
from .state import Known
from .tiles import Place, TiledMap
from .top_view import CELL, Pose, ages_image, cloud_from_above, path_points, pose_of, scan_points
from .transforms import Transforms

HOLD = 5.0
"""A topic stays subscribed for this long after the last browser that showed it [s]."""

SCAN_PERIOD, CLOUD_PERIOD = 0.2, 0.5
"""From one scan or cloud to the next that is shown [s]."""

SCAN_SLACK = 0.9
"""Ratio of a period after which a message already counts as due: sources are not even."""

MAX_PATH = 500
"""Points of a path."""

TREE_PERIOD = 1.0
"""How often the link's numbers are read [s]."""

AGES, VALUES = 'ages', 'values'
"""What may be wanted of a stream beside it."""

Changed = Callable[[str], None]


class Shown(NamedTuple):
    """A frame that browsers may show."""
    number: int
    """It grows."""
    frame: Frame
    stamp: float
    """By the robot's clock [s]."""


class Robot(Part):
    """Lives as long as its node. rospy's threads fill it; the server's loop reads it.

    :param name: of the robot, its namespace at this desk; empty: there is none
    :param resolve: f(relative name) -> full name of a topic or service
    :param frames: of streams.yaml
    :param prefix: of the robot's frames
    :param changed: f(stream), called in any thread where a picture came
    """

    def __init__(self, name: str, resolve: Callable[[str], str], catalogue: Catalogue, frames: Frames, prefix: str,
                 changed: Changed) -> None:
        super().__init__()
        self.name, self.resolve, self.catalogue = name, resolve, catalogue
        self.fixed, self.base = with_prefix(frames.fixed, prefix), with_prefix(frames.base, prefix)
        self.known, self.log = Known(), LogEntries()
        self.pictures = {entry.name: Pictures() for entry in catalogue.entries.values() if entry.kind == IMAGE}
        self.maps = {entry.name: TiledMap() for entry in catalogue.entries.values() if entry.kind == MAP}
        self.map_lock = threading.Lock()
        self.shown: Dict[Tuple[Kind, str], Shown] = {}
        self.raw: Dict[str, Any] = {}
        """{image stream: its newest sensor_msgs/Image}, while VALUES of it are wanted."""
        self.goal: Optional[Tuple[Pose, float]] = None
        """In the fixed frame, and when it was set, by a steady clock [s]."""
        self.path: Array = np.zeros((0, 2))
        self.progress: Optional[Tuple[int, Any]] = None
        """Number and message of the newest progress of a capture."""
        self._transforms, self._changed, self._colours = Transforms(), changed, RelayedColours()
        self._numbers = 0
        self._wanted: Dict[Tuple[str, str], float] = {}     # {(what, stream): when it was wanted last [s]}
        self._subscribed: Dict[Tuple[str, str], Any] = {}
        self._due: Dict[str, float] = {}
        for stream in catalogue.hidden:
            logerr("stream '%s'" % stream, 'browsers cannot show it: its view_topic is none')
        with udpros.registered_together():
            self._subscribe_small()
        node = resolve('operator_receiver')
        self._listener = BoardListener(node.rpartition('/')[0] or node)
        self._opened.started(PeriodicWorker('link', self._read_tree, log_error('link'), TREE_PERIOD))
        self._topics = self._opened.started(PeriodicWorker('topics', self._follow_wishes, log_error('topics'), 1.0))

    # -- the server's loop --------------------------------------------------------------------------------

    def want(self, wanted: Set[Tuple[str, str]]) -> None:
        """What browsers show now: (kind of stream, AGES or VALUES; its name); any thread, repeatedly."""
        now = time.monotonic()
        wanted = {(what, stream) for what, stream in wanted if stream in self.catalogue.entries}
        new = wanted - self._wanted.keys()
        self._wanted = {**self._wanted, **{one: now for one in wanted}}
        if new:
            self._topics.wake()

    def robot_now(self) -> float:
        """The robot's clock, as it is estimated [s]."""
        operators = self.known.tree.get('operators') or [{}]
        clock = operators[0].get('clock') or {}
        return float(rospy.get_time() + (clock.get('offset') or 0.0))

    def pose(self) -> Optional[Pose]:
        """The robot's base in the fixed frame; None: unknown."""
        return self._transforms.pose(self.fixed, self.base, self.robot_now())

    def map_place(self, stream: str) -> Optional[Place]:
        """Where cell (0, 0) of a map's lattice is, in the fixed frame; None: unknown."""
        anchor = self.maps[stream].anchor
        if anchor is None:
            return None
        pose = self._pose_in_fixed(anchor.frame)
        if pose is None:
            return None
        x, y, _ = pose.apply(np.array([[anchor.x, anchor.y, 0.0]]))[0].tolist()
        return Place(x, y, anchor.yaw + pose.yaw, anchor.resolution, self.fixed)

    # -- subscriptions ------------------------------------------------------------------------------------

    def _subscribe_small(self) -> None:
        relayed = self.catalogue.relayed
        for type_, class_, attribute in (('smokebot_udp/LinkStatus', LinkStatus, 'link'),
                                         ('smokebot_udp/RobotStatus', RobotStatus, 'status'),
                                         ('sensor_msgs/BatteryState', BatteryState, 'battery')):
            for _, topic in relayed(type_)[:1]:
                self._listen(topic, class_, functools.partial(self._keep, attribute))
        for class_ in (Float32, Float64):
            for name, topic in relayed(class_._type):
                self._listen(topic, class_, functools.partial(self._take_number, name))
        transforms = [(topic, name) for name, topic in relayed('tf2_msgs/TFMessage', 'tf/tfMessage')]
        for topic, name in transforms:
            static = name.endswith('static') or topic.endswith('static')
            self._listen(topic, TFMessage, functools.partial(self._take_transforms, static=static))
        if not transforms:
            for topic, static in (('/tf', False), ('/tf_static', True)):
                self._listen(topic, TFMessage, functools.partial(self._take_transforms, static=static))
        for _, topic in relayed('rosgraph_msgs/Log'):
            self._listen(topic, Log, lambda message: self.log.add(message, 'robot'))
        self._listen('/rosout_agg', Log, self._take_own_log)
        self._listen('operator/control', String, self._take_control)
        self._listen('operator/path', Path, self._take_path)
        self._listen('operator_receiver/capture_progress', CaptureProgress, self._take_progress)
        goals = self.catalogue.sent('geometry_msgs/PoseStamped', 'relay')
        if goals is not None:
            self._listen(goals, PoseStamped, self._take_goal)

    def _listen(self, topic: str, class_: Any, take: Callable[[Any], None]) -> Any:
        full = topic if topic.startswith('/') else self.resolve(topic)
        return self._opened.topic(rospy.Subscriber(full, class_, take, queue_size=5, tcp_nodelay=True))

    def _follow_wishes(self) -> None:
        """Subscribe what is wanted, and no longer what has not been wanted for some time."""
        now = time.monotonic()
        wanted = {one for one, when in list(self._wanted.items()) if now < when + HOLD}
        self._wanted = {one: when for one, when in list(self._wanted.items()) if one in wanted}
        for one in wanted - self._subscribed.keys():
            self._subscribed[one] = self._open(*one)
        for one in self._subscribed.keys() - wanted:
            for subscriber in self._subscribed.pop(one):
                subscriber.unregister()
            if one[0] == VALUES:
                self.raw.pop(one[1], None)

    def close(self) -> None:
        super().close()
        for subscribers in self._subscribed.values():
            for subscriber in subscribers:
                subscriber.unregister()

    def _open(self, what: str, stream: str) -> Tuple[Any, ...]:
        """The subscribers of what is wanted; none where there is no such stream."""
        entry = self.catalogue.entries.get(stream)
        if entry is None:
            return ()
        topic = entry.topic
        wanted: Mapping[str, Tuple[Tuple[str, Any, Callable[[Any, Entry], None]], ...]] = {
            IMAGE: ((topic + PLAIN, ViewImage, self._take_view),) if entry.annotated else (
                (topic, CompressedImage if 'Compressed' in entry.settings.get('message_type', '') else Image,
                 self._take_relayed_image),),
            MAP: ((topic, numpy_msg(OccupancyGrid), self._take_map),
                  (topic + UPDATES, numpy_msg(OccupancyGridUpdate), self._take_update)),
            AGES: ((topic + '/age', numpy_msg(OccupancyGrid), self._take_ages),),
            POINTS: ((topic, numpy_msg(LaserScan), self._take_scan),),
            CLOUD: ((topic, PointCloud2, self._take_cloud),),
            VALUES: ((entry.settings['operator_topic'].lstrip('/'), Image, self._take_raw),)}
        return tuple(rospy.Subscriber(self.resolve(name), class_, functools.partial(self._safely, take), entry,
                                      queue_size=2 if what != MAP else 256, buff_size=1 << 22, tcp_nodelay=True)
                     for name, class_, take in wanted.get(what, ()))

    def _safely(self, take: Callable[[Any, Entry], None], message: Any, entry: Entry) -> None:
        """Take a message; one that cannot be shown is reported, and the next one may be good."""
        try:
            take(message, entry)
        except ValueError as error:
            logerr("stream '%s'" % entry.name, 'browsers cannot show a message: %s' % error)

    # -- rospy's threads ----------------------------------------------------------------------------------

    def _keep(self, attribute: str, message: Any) -> None:
        now = time.monotonic()
        if attribute == 'link':
            self.known.linked = now
        self.known.heard = now
        setattr(self.known, attribute, message)

    def _take_number(self, name: str, message: Any) -> None:
        self.known.gas[name] = message.data

    def _take_control(self, message: Any) -> None:
        self.known.stops += message.data == EMERGENCY_STOP != self.known.control
        self.known.control = message.data

    def _take_transforms(self, message: Any, static: bool) -> None:
        self.known.heard = time.monotonic()
        self._transforms.take(message, static)

    def _take_own_log(self, message: Any) -> None:
        """A line of a node at this master; of several robots' each has its own."""
        if message.level >= Log.WARN and message.name.startswith(self.resolve('operator')):
            self.log.add(message, 'operator')

    def _take_path(self, message: Any) -> None:
        pose = self._pose_in_fixed(message.header.frame_id)
        if pose is not None and message.poses:
            positions = np.array([(one.pose.position.x, one.pose.position.y, 0.0) for one in message.poses])
            self.path = path_points(pose.apply(positions)[:, :2], MAX_PATH)

    def _take_progress(self, message: Any) -> None:
        self._numbers += 1
        self.progress = self._numbers, message

    def _take_goal(self, message: Any) -> None:
        pose = self._pose_in_fixed(message.header.frame_id)
        if pose is not None:
            goal = pose_of(message.pose)
            self.goal = Pose(pose.rotation @ goal.rotation, pose.apply(goal.translation[np.newaxis])[0]
                             ), time.monotonic()

    def _take_view(self, message: Any, entry: Entry) -> None:
        self.pictures[entry.name].newest = picture_of(message, time.monotonic())
        self._changed(entry.name)

    def _take_relayed_image(self, message: Any, entry: Entry) -> None:
        self.pictures[entry.name].newest = self._colours.picture(message, time.monotonic(), self.robot_now())
        self._changed(entry.name)

    def _take_raw(self, message: Any, entry: Entry) -> None:
        self.raw[entry.name] = message

    def _take_map(self, message: Any, entry: Entry) -> None:
        info = message.info
        if len(message.data) != info.width * info.height:
            raise ValueError('a map of %d x %d cells with %d values' % (info.width, info.height, len(message.data)))
        pose = pose_of(info.origin)
        x, y, _ = pose.translation.tolist()
        with self.map_lock:
            self.maps[entry.name].set(Place(x, y, pose.yaw, info.resolution, message.header.frame_id),
                                      message.data.reshape(info.height, info.width))

    def _take_update(self, message: Any, entry: Entry) -> None:
        if len(message.data) != message.width * message.height:
            raise ValueError('an update of %d x %d cells with %d values' % (
                message.width, message.height, len(message.data)))
        with self.map_lock:
            self.maps[entry.name].update(message.x, message.y, message.data.reshape(message.height, message.width))

    def _take_ages(self, message: Any, entry: Entry) -> None:
        info, pose = message.info, self._pose_in_fixed(message.header.frame_id)
        if pose is None or not len(message.data) or len(message.data) != info.width * info.height:
            return
        corner = pose_of(info.origin)
        x, y, _ = pose.apply(corner.translation[np.newaxis])[0].tolist()
        self._show(Kind.AGES, entry, {'x': x, 'y': y, 'yaw': pose.yaw + corner.yaw, 'resolution': info.resolution},
                   ages_image(message.data.reshape(info.height, info.width)), 0.0)

    def _take_scan(self, message: Any, entry: Entry) -> None:
        if not self._is_due(entry, SCAN_PERIOD):
            return
        pose = self._pose_in_fixed(message.header.frame_id)
        if pose is None:
            raise ValueError('tf does not know frame %r' % message.header.frame_id)
        points = scan_points(message.ranges, message.angle_min, message.angle_increment,
                             (message.range_min, message.range_max), pose)
        self._show(Kind.POINTS, entry, {}, points.tobytes(), message.header.stamp.to_sec())

    def _take_cloud(self, message: Any, entry: Entry) -> None:
        if not self._is_due(entry, CLOUD_PERIOD):
            return
        pose, base = self._pose_in_fixed(message.header.frame_id), self.pose()
        if pose is None or base is None:
            raise ValueError('tf does not know frame %r or the robot' % message.header.frame_id)
        points, _ = as_points(message)
        view = cloud_from_above(points, pose, base)
        self._show(Kind.CLOUD, entry, {'x': view.x, 'y': view.y, 'resolution': CELL}, view.png,
                   message.header.stamp.to_sec())

    def _show(self, kind: Kind, entry: Entry, metadata: Mapping[str, Any], data: bytes, stamp: float) -> None:
        self._numbers += 1
        self.shown[kind, entry.name] = Shown(self._numbers, Frame(kind, entry.number, metadata, data), stamp)

    def _is_due(self, entry: Entry, period: float) -> bool:
        now = time.monotonic()
        if now < self._due.get(entry.name, -math.inf):
            return False
        self._due[entry.name] = now + SCAN_SLACK * period
        return True

    def _pose_in_fixed(self, frame: str) -> Optional[Pose]:
        return self._transforms.pose(self.fixed, frame, self.robot_now())

    def _read_tree(self) -> None:
        self.known.tree = tree = self._listener.tree()
        self.known.paths = paths_of(tree, route_to)
