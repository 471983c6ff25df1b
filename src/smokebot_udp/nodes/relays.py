# SPDX-License-Identifier: BSD-3-Clause
"""Makes the robot's and the operator's side of reliable relays."""
from typing import Any, Mapping, Type

import rospy

from ..streams.frame_prefix import add_prefix, strip_prefix
from ..streams.relay.parameters import DIAGNOSTICS, TO_OPERATOR
from .common import operator_topic
from .diagnostics_relay import DiagnosticsSink, DiagnosticsSource
from .reliable_relay import NewestSource, ReliableRelay, Sink, Source
from .way import OperatorWay, RobotWay


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
