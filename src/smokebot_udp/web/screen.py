# SPDX-License-Identifier: BSD-3-Clause
"""What one browser shows, what it was sent, and what is due: only what is new, and of each stream the newest alone."""
import math
from typing import Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Set, Tuple, Union

from ..newest import Newest
from .flow import Flow
from .frames import Frame, Kind, text_of
from .pictures import metadata, step_of
from .requests import Watch
from .robot import AGES, Robot
from .state import urgent
from .tiles import Key
from .top_view import goal_fields

Message = Union[str, bytes]

PERIOD_SLACK = 0.75
"""Ratio of a period after which an image already counts as due: sources are not even."""

STATE_PERIOD, POSE_PERIOD, PATH_PERIOD, LINK_PERIOD, OVERVIEW_PERIOD = 0.5, 0.09, 1.0, 1.0, 1.0
LOG_PERIOD, PROGRESS_PERIOD = 0.2, 0.2
"""Times from one message of a type to the next [s]."""

MAX_TILES, MAX_SENT_TILES, TILE_BATCH = 1000, 4096, 8
"""Tiles on the way, tiles that are remembered, tiles that are made at once."""


class Now(NamedTuple):
    """A moment."""
    steady: float
    """[s]"""
    clock: float
    """Unix time [s]."""


class _SentViews:
    """What a browser was sent of the robot that it watches."""

    def __init__(self) -> None:
        self.images: Dict[str, Tuple[int, int]] = {}        # {stream: (number of the picture, width)}
        self.image_due: Dict[str, float] = {}
        self.shown: Dict[Tuple[Kind, str], int] = {}
        self.tiles: Newest[Tuple[str, int, Key], int] = Newest(MAX_SENT_TILES)      # {...: version}
        self.complete: Any = None       # state of the map and of what is wanted in which no tile was due
        self.places: Dict[str, Any] = {}
        self.due: Dict[str, float] = {}
        self.values: Dict[str, Any] = {}
        self.log = self.progress = 0

    def forget_map(self) -> None:
        """The page has dropped its map."""
        self.tiles.clear()
        self.places.clear()
        self.complete = None


class Screen:
    """Decides what is sent to one browser."""

    def __init__(self) -> None:
        self.watch, self.flow = Watch(), Flow()
        self.robot: Optional[Robot] = None
        self._sent = _SentViews()

    def show(self, watch: Watch, robot: Optional[Robot]) -> None:
        """Show something else from now on."""
        if robot is not self.robot:
            self._sent = _SentViews()
        if watch.log and not self.watch.log:
            self._sent.log = 0
        if (watch.map and watch.map.stream) != (self.watch.map and self.watch.map.stream):
            self._sent.forget_map()
        self.watch, self.robot = watch, robot

    def wanted(self) -> Set[Tuple[str, str]]:
        """What has to be subscribed, see Robot.want."""
        watch = self.watch
        found = {('image', stream) for stream in watch.images} | {('points', stream) for stream in watch.points}
        if watch.map is not None:
            found |= {('map', watch.map.stream)} | ({(AGES, watch.map.stream)} if watch.ages else set())
        return found | ({('cloud', watch.cloud)} if watch.cloud is not None else set())

    def images(self, now: Now) -> Iterator[bytes]:
        """The images to be sent now."""
        robot, sent = self.robot, self._sent
        if robot is None:
            return
        for stream, wanted in self.watch.images.items():
            pictures = robot.pictures.get(stream)
            current = pictures.current if pictures is not None else None
            step = step_of(wanted.width)
            if current is None or step not in current.encoded or \
                    sent.images.get(stream) == (current.number, step) or \
                    now.steady < sent.image_due.get(stream, -math.inf) or not self.flow.room(stream):
                continue
            sent.images[stream] = current.number, step
            sent.image_due[stream] = now.steady + PERIOD_SLACK / wanted.rate
            encoded = current.encoded[step]
            yield self._framed(stream, Frame(
                Kind.IMAGE, robot.catalogue.entries[stream].number,
                metadata(current.picture, encoded, now.steady, now.clock), encoded.data))

    def texts(self, now: Now, state: Callable[[Robot], Mapping[str, Any]]) -> Iterator[str]:
        """The messages to be sent now, but the overview.

        :param state: f(robot) -> its state, with who of the browsers drives
        """
        robot = self.robot
        if robot is None:
            return
        for fields in (*self._states(robot, now, state), *self._places(robot), *self._log(robot, now),
                       *self._progress(robot, now)):
            yield text_of(fields)

    def shown(self, now: float, robot_now: Callable[[], float]) -> Iterator[bytes]:
        """Scans, the cloud, ages of the map.

        :param robot_now: f() -> the robot's clock [s]
        """
        robot, watch = self.robot, self.watch
        if robot is None:
            return
        wanted = [(Kind.POINTS, stream) for stream in watch.points]
        wanted += [(Kind.CLOUD, watch.cloud)] if watch.cloud is not None else []
        wanted += [(Kind.AGES, watch.map.stream)] if watch.map is not None and watch.ages else []
        for key in wanted:
            one = robot.shown.get(key)
            if one is None or self._sent.shown.get(key) == one.number or not self.flow.room(key, 1):
                continue
            self._sent.shown[key] = one.number
            more = {'stamp': one.stamp, 'age': round(robot_now() - one.stamp, 3)} if one.stamp else {}
            yield self._framed(key, one.frame._replace(metadata={**one.frame.metadata, **more}))

    def tiles_due(self) -> List[Tuple[int, Key, int]]:
        """Tiles of the map to be sent next, in (id of the map, tile, its version); the map's lock is held.

        There are none before the map's place was sent: the page drops tiles of a map that it does not know. Tiles that
        were never sent come first: those that change all the time must not keep them.
        """
        robot, wanted = self.robot, self.watch.map
        if robot is None or wanted is None or wanted.stream not in robot.maps:
            return []
        tiled, anchor = robot.maps[wanted.stream], robot.map_place(wanted.stream)
        state = tiled.id, tiled.changes, tiled.area, wanted, anchor
        if (anchor is None or state == self._sent.complete or not self.flow.room('tiles', MAX_TILES)
                or self._sent.places.get(wanted.stream, {}).get('id') != tiled.id):
            return []
        new: List[Tuple[int, Key, int]] = []
        changed: List[Tuple[int, Key, int]] = []
        for key, version in tiled.versions(wanted.level, tiled.cells_in(*wanted.area, anchor)):
            sent = self._sent.tiles.get((wanted.stream, tiled.id, key))
            if sent != version:
                (new if sent is None else changed).append((tiled.id, key, version))
            if len(new) >= TILE_BATCH:
                break
        if not new and not changed:
            self._sent.complete = state
        return (new + changed)[:TILE_BATCH]

    def tile(self, tile: Tuple[int, Key, int], png: bytes) -> bytes:
        """A tile that is sent now."""
        robot, wanted = self.robot, self.watch.map
        assert robot is not None and wanted is not None
        id_, key, version = tile
        self._sent.tiles[wanted.stream, id_, key] = version
        return self._framed('tiles', Frame(Kind.TILE, robot.catalogue.entries[wanted.stream].number, {
            'id': id_, 'column': key.column, 'row': key.row}, png, key.level))

    def due(self, name: str, period: float, now: float) -> bool:
        """Whether something is due that is sent once a period at most [s]."""
        if now < self._sent.due.get(name, -math.inf):
            return False
        self._sent.due[name] = now + period
        return True

    def _framed(self, stream: Any, frame: Frame) -> bytes:
        content = frame.serialised(self.flow.next())
        self.flow.sent(stream, len(content))
        return content

    def _changed(self, name: str, value: Any) -> bool:
        """Whether a value differs from the one that was sent; it counts as sent then."""
        if self._sent.values.get(name, self) == value:
            return False
        self._sent.values[name] = value
        return True

    def _states(self, robot: Robot, now: Now, state: Callable[[Robot], Mapping[str, Any]]
                ) -> Iterator[Mapping[str, Any]]:
        steady, present = now.steady, state(robot)
        regular = self.due('state', STATE_PERIOD, steady)
        if self._changed('state', (urgent(present), present['browser'])) or regular:
            yield present
        if self.due('pose', POSE_PERIOD, steady):
            pose = robot.pose()
            x, y = (None, None) if pose is None else (round(one, 3) for one in pose.translation[:2].tolist())
            place = {'type': 'pose', 'x': x, 'y': y, 'yaw': pose and round(pose.yaw, 4)}
            age = None if pose is None or pose.age is None else round(pose.age, 3)
            if self._changed('pose', place) or regular:
                yield {**place, 'age': age}
        goal = robot.goal
        if self._changed('goal', goal and goal[1]):
            yield {'type': 'goal', **goal_fields(None if goal is None else (
                *goal[0].translation[:2].tolist(), goal[0].yaw, round(steady - goal[1], 3)))}
        path = robot.path
        if self.watch.path and self.due('path', PATH_PERIOD, steady) and self._changed('path', id(path)):
            yield {'type': 'path', 'points': path.round(3).tolist()}
        if self.watch.link and self.due('link', LINK_PERIOD, steady):
            yield {'type': 'link', 'tree': robot.known.tree}

    def _places(self, robot: Robot) -> Iterator[Mapping[str, Any]]:
        """The place of the map, where it is new."""
        wanted = self.watch.map
        place = robot.map_place(wanted.stream) if wanted is not None and wanted.stream in robot.maps else None
        if wanted is None or place is None:
            return
        tiled = robot.maps[wanted.stream]
        fields = {'type': 'map', 'stream': wanted.stream, 'id': tiled.id, 'x': round(place.x, 4),
                  'y': round(place.y, 4), 'yaw': round(place.yaw, 5), 'resolution': round(place.resolution, 6),
                  'area': list(tiled.area)}
        if self._sent.places.get(wanted.stream) != fields:
            self._sent.places[wanted.stream] = fields
            yield fields

    def _log(self, robot: Robot, now: Now) -> Iterator[Mapping[str, Any]]:
        if self.watch.log and self.due('log', LOG_PERIOD, now.steady):
            self._sent.log, entries = robot.log.after(self._sent.log)
            if entries:
                yield {'type': 'log', 'entries': entries}

    def _progress(self, robot: Robot, now: Now) -> Iterator[Mapping[str, Any]]:
        if robot.progress is None or not self.due('progress', PROGRESS_PERIOD, now.steady):
            return
        number, message = robot.progress
        if number != self._sent.progress:
            self._sent.progress = number
            yield {'type': 'progress', 'stream': message.stream, 'progress': round(message.progress, 4),
                   'received': message.received, 'size': message.size, 'state': message.state}
