# SPDX-License-Identifier: BSD-3-Clause
"""The way back: all streams of a node by which operators command the robot, and those that are acknowledged."""
from typing import Callable, Dict, List, Mapping

from ..mission.settings import SettingsStore
from ..monitoring.status import OPERATOR, ROBOT, Status
from ..streams import Definitions
from .common import Parameters, start_streams
from .operator_action import OperatorAction
from .operator_command import OperatorCommand
from .operator_service import OperatorService
from .relays import operator_relay, robot_relay
from .robot_action import RobotAction
from .robot_command import RobotCommand
from .robot_service import RobotService
from .way import Way, WayBackStream

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
