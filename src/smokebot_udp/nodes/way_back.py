# SPDX-License-Identifier: BSD-3-Clause
"""The way back: all streams of a node by which operators command the robot, and those that are acknowledged; among them
both sides of reliable relays."""
from typing import Any, Callable, Dict, List, Mapping, Type

import rospy

from ..mission.settings import SettingsStore
from ..monitoring.status import OPERATOR, ROBOT, Status
from ..streams import Definitions
from ..streams.frame_prefix import add_prefix, strip_prefix
from ..streams.relay.parameters import DIAGNOSTICS, TO_OPERATOR
from .common import Parameters, operator_topic, start_streams
from .diagnostics_relay import DiagnosticsSink, DiagnosticsSource
from .operator_action import OperatorAction
from .operator_command import OperatorCommand
from .operator_service import OperatorService
from .reliable_relay import NewestSource, ReliableRelay, Sink, Source
from .robot_action import RobotAction
from .robot_command import RobotCommand
from .robot_service import RobotService
from .way import OperatorWay, RobotWay, Way, WayBackStream


def robot_relay(name: str, settings: Mapping[str, Any], way: RobotWay) -> ReliableRelay:
    """The robot's side of a relay."""
    topic = rospy.resolve_name(settings['robot_topic'])
    if settings['direction'] == TO_OPERATOR:
        return _source(settings)(name, settings, way.reliable, topic)
    if settings['needs_control']:
        return _sink(settings)(name, settings, way.reliable, topic,
                               refusal=lambda peer: way.control.standing.refusal(peer))
    return _sink(settings)(name, settings, way.reliable, topic)


def operator_relay(name: str, settings: Mapping[str, Any], way: OperatorWay) -> ReliableRelay:
    """The operator's side of a relay. Frames have the operator's prefix on its side only."""
    topic, prefix = operator_topic(settings['operator_topic']), way.frame_prefix
    if settings['direction'] == TO_OPERATOR:
        return _sink(settings)(name, settings, way.reliable, topic, lambda message: add_prefix(message, prefix))
    return _source(settings)(name, settings, way.reliable, topic, lambda message: strip_prefix(message, prefix))


def _source(settings: Mapping[str, Any]) -> Type[Source]:
    """The class of the side that sends."""
    if not settings['newest']:
        return Source
    return DiagnosticsSource if settings['message_type'] == DIAGNOSTICS else NewestSource


def _sink(settings: Mapping[str, Any]) -> Type[Sink]:
    """The class of the side that receives."""
    return DiagnosticsSink if settings['newest'] and settings['message_type'] == DIAGNOSTICS else Sink


MAKERS: Dict[str, Mapping[str, Callable[..., WayBackStream]]] = {
    ROBOT: {'command': RobotCommand, 'relay': robot_relay, 'service': RobotService, 'action': RobotAction},
    OPERATOR: {'command': OperatorCommand, 'relay': operator_relay, 'service': OperatorService,
               'action': OperatorAction}}
"""{side: {type of a stream: f(name, settings, way) -> stream}}"""


class WayBack:
    """Hosts the way back of a node; lives as long as the node.

    :param side: ROBOT or OPERATOR
    :param definitions: of streams.yaml
    :param way: of this side
    """

    def __init__(self, side: str, definitions: Definitions, way: Way, parameters: Parameters) -> None:
        self._control = way.control
        self.streams: Dict[str, WayBackStream] = start_streams(
            {**definitions.commands, **definitions.reliable, **definitions.services, **definitions.actions},
            lambda name, settings: MAKERS[side][settings['type']](name, settings, way), parameters.report,
            parameters.refused.__setitem__)
        """{name: stream}, started"""

    @property
    def stores(self) -> Dict[str, SettingsStore]:
        """{stream: its settings} of those with settings that may change."""
        return {name: stream.settings for name, stream in self.streams.items() if stream.settings.table}

    def statuses(self, now: float) -> List[Status]:
        """For diagnostics, besides those of the streams."""
        return [self._control.status(now)]

    def close(self) -> None:
        """End all streams, commands first."""
        for stream in self.streams.values():
            stream.close()
