# SPDX-License-Identifier: BSD-3-Clause
"""The way back: all streams of a node by which operators command the robot, and those that are acknowledged.

Each kind has a class for either side, which is imported when the first stream of it is made. It is made of a stream's
name, its settings and a way.RobotWay or way.OperatorWay, and has start(), close(), stats(), `name`, `topic`,
`source` and `settings`, as RobotStream has them.
"""
import importlib
from typing import Any, Callable, Dict, List, Optional

from ..mission.settings import SettingsStore
from ..monitoring.status import OPERATOR, ROBOT, Status
from ..streams import Definitions
from ..transport import Transport
from .common import Parameters, start_streams
from .outbox import Outbox
from .way_back_policy import refused

MAKERS = {
    'command': ('robot_command.RobotCommand', 'operator_command.OperatorCommand'),
    'relay': ('relays.robot_relay', 'relays.operator_relay'),
    'service': ('robot_service.RobotService', 'operator_service.OperatorService'),
    'action': ('robot_action.RobotAction', 'operator_action.OperatorAction'),
}
"""{type of a stream: what makes it on the robot's side, and on the operator's}"""

ANSWERING = ('service', 'action')
"""Types whose streams are made also where they are refused, on the operator's side."""


class WayBack:
    """Hosts the way back of a node; lives as long as the node.

    :param side: ROBOT or OPERATOR
    :param definitions: of streams.yaml
    :param control: RobotControl or OperatorControl, which ends with this
    :param make_way: f(ReliableLink or None) -> RobotWay or OperatorWay
    :param outbox: on the robot's side
    """

    def __init__(self, side: str, definitions: Definitions, control: Any, make_way: Callable[[Any], Any],
                 transport: Transport, parameters: Parameters, outbox: Optional[Outbox] = None) -> None:
        self._side, self._control = side, control
        acknowledged = {**definitions.reliable, **definitions.services, **definitions.actions}
        defined = {**definitions.commands, **acknowledged}
        self.refused = refused(defined, transport, parameters['allow_unsealed_commands'])
        """{stream: why it is refused}"""
        for sentence in self.refused.values():
            parameters.report(sentence)
        wanted = {name: settings for name, settings in defined.items() if name not in self.refused}
        self._reliable: Any = None
        if wanted.keys() & acknowledged.keys():
            from .reliable_link import ReliableLink
            self._reliable = ReliableLink(transport, side, outbox)
        way = make_way(self._reliable)
        if side == OPERATOR:    # whoever calls a refused service, or sends a goal, is told why
            wanted.update((name, settings) for name, settings in defined.items() if settings['type'] in ANSWERING)

        def make_stream(name: str, settings: Dict[str, Any]) -> Any:
            why = {'refused': self.refused[name]} if name in self.refused else {}
            return _maker_of(settings['type'], side)(name, settings, way, **why)
        parameters.refused.update(self.refused)
        self.streams: Dict[str, Any] = start_streams(wanted, make_stream, parameters.report,
                                                     parameters.refused.__setitem__)
        """{name: stream}, started"""
        if self._reliable is not None:
            self._reliable.start()

    @property
    def stores(self) -> Dict[str, SettingsStore]:
        """{stream: its settings} of those with settings that may change."""
        return {name: stream.settings for name, stream in self.streams.items() if stream.settings.table}

    def statuses(self, now: float) -> List[Status]:
        """For diagnostics, besides those of the streams."""
        return [self._control.status(now)]

    def close(self) -> None:
        """End all streams, and the control."""
        for stream in self.streams.values():
            stream.close()
        if self._reliable is not None:
            self._reliable.close()
        self._control.close()


def _maker_of(kind: str, side: str) -> Any:
    """What makes a type's streams on one side."""
    module, name = MAKERS[kind][0 if side == ROBOT else 1].split('.')
    return getattr(importlib.import_module('.' + module, __package__), name)
