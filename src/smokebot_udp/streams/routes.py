# SPDX-License-Identifier: BSD-3-Clause
"""What the streams of a streams.yaml publish and serve on both sides, and whether that fits together.

Relative names of the robot's side are compared as they are written: its node resolves them in its namespace. Those of
the operator's side are all in the namespace of its node.
"""
from typing import Any, Dict, List, Mapping, NamedTuple, Optional

from . import encoder_class
from .image.camera_info import info_topic
from .message_types import action_types
from .relay.parameters import TO_ROBOT

UPDATES = '_updates'
"""Appended to the topic of a map: the topic of its updates, as costmaps and rviz have it."""

Routes = List['Route']


class Route(NamedTuple):
    """A topic of one side whose messages are published on the other, or a service of the robot."""
    setting: str
    """Setting that has its names: topic, service, or action where the topic is one of an action's."""
    robot: str
    """Its name on the robot, normalised."""
    operator: str
    """Its name on the operator's side, normalised."""
    to_robot: bool
    """Whether messages, or calls, go to the robot."""
    type: str
    """Type of the messages, or of the service: package/Type."""

    @property
    def offered(self) -> str:
        """The side on which this package publishes the topic, or serves the service: robot or operator."""
        return 'robot' if self.to_robot and self.setting != 'service' else 'operator'

    def name(self, side: str) -> str:
        """Its name on the side robot or operator."""
        return self.robot if side == 'robot' else self.operator

    def same(self, other: 'Route', side: str) -> bool:
        """Whether both have one name on the side robot or operator."""
        if (self.setting == 'service') != (other.setting == 'service'):
            return False
        if side == 'operator':
            return self.operator.lstrip('/') == other.operator.lstrip('/')
        return self.robot == other.robot

    def feeds(self, other: 'Route') -> bool:
        """Whether what this one publishes is what the other one sends; the same with calls."""
        if self.to_robot != other.to_robot:
            return self.same(other, 'robot' if self.to_robot else 'operator')
        published, sent = (self.robot, other.operator) if self.to_robot else (self.operator, other.robot)
        # both sides may share a master
        return published.startswith('/') and published == sent and (
            self.setting == 'service') == (other.setting == 'service')


def routes_of(settings: Mapping[str, Any]) -> Routes:
    """The topics and services of a stream.

    :param settings: {name: value} of streams.yaml, each checked
    :raises ValueError: where a type is not installed
    """
    kind = settings['type']
    if kind == 'service':
        return [Route('service', normalised(settings['robot_service']), normalised(settings['operator_service']), True,
                      settings['service_type'])]
    if kind == 'action':
        robot, operator = normalised(settings['robot_action']), normalised(settings['operator_action'])
        return [Route('action', '%s/%s' % (robot, part), '%s/%s' % (operator, part), part in ('goal', 'cancel'),
                      class_._type)
                for part, class_ in action_types(settings['action_type'])._asdict().items()]
    type_ = settings.get('message_type') or encoder_class(kind).MESSAGE._type
    robot, operator = normalised(settings['robot_topic']), normalised(settings['operator_topic'])
    found = [Route('topic', robot, operator, kind == 'command' or settings.get('direction') == TO_ROBOT, type_)]
    if settings.get('publish_updates'):
        updates = settings['updates_topic'] or settings['robot_topic'] + UPDATES
        found.append(Route('topic', normalised(updates), normalised(settings['operator_topic'] + UPDATES), False,
                           'map_msgs/OccupancyGridUpdate'))
    if settings.get('camera_info'):
        found.append(Route('topic', info_topic(robot), info_topic(operator), False, 'sensor_msgs/CameraInfo'))
    return found


def check_routes(routes: Routes, others: Mapping[str, Routes]) -> None:
    """Check the topics and services of a stream against those of the streams before it.

    :param others: {name: its routes}
    :raises ValueError: where what it publishes comes back to it, a name that it publishes or serves is that of another
        stream, or another stream expects another type there
    """
    for route in routes:
        if route.feeds(route):
            raise ValueError('robot_{0} and operator_{0} are both {1}: {2}'.format(
                route.setting, route.operator,
                'the service would call itself' if route.setting == 'service' else
                'the stream would send again and again what it publishes itself'))
        for name, theirs in others.items():
            for other in theirs:
                _compare(route, other, name)
    back = _way_back(routes, others)
    if back:
        raise ValueError("what it sends would come back to it by way of stream '%s', again and again" % back)


def _compare(route: Route, other: Route, name: str) -> None:
    """Compare two routes.

    :param name: of the other one's stream
    :raises ValueError: where they contradict each other
    """
    side = route.offered
    if side == other.offered and route.same(other, side):
        raise ValueError("%s_%s %s is already the %s_%s of stream '%s'" % (
            side, route.setting, route.name(side), side, other.setting, name))
    for side in ('robot', 'operator'):
        if route.same(other, side) and route.type != other.type:
            raise ValueError("%s_%s %s must be %s, but %s for stream '%s'" % (
                side, route.setting, route.name(side), route.type, other.type, name))


def _way_back(routes: Routes, others: Mapping[str, Routes]) -> Optional[str]:
    """The last stream on the way by which what a stream sends comes back to it; None: there is none."""
    reached = list(routes)
    waiting: Dict[str, Routes] = dict(others)
    for route in reached:
        for name in [name for name, theirs in waiting.items() if any(map(route.feeds, theirs))]:
            entered = [other for other in waiting[name] if route.feeds(other)]
            if any(other.feeds(own) for other in entered for own in routes):
                return name
            waiting[name] = [other for other in waiting[name] if other not in entered]
            reached += entered
    return None


def normalised(topic: str) -> str:
    """The name of a topic without superfluous slashes."""
    return '/' * topic.startswith('/') + '/'.join(part for part in topic.split('/') if part)
