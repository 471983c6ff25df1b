# SPDX-License-Identifier: BSD-3-Clause
"""The streams of the way back: commands, reliable relays, services and actions; and what they share with the other
parts of their node, see way_back.py.
"""
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Callable, Mapping, Optional, Union

from ..mission.parameters import Table
from ..mission.settings import SettingsStore
from ..monitoring.sources import Source
from ..monitoring.stats import StreamStats
from ..transport import Transport
from .opened import Part
from .operator_control import OperatorControl
from .reliable_link import ReliableLink
from .robot_control import RobotControl


@dataclass(frozen=True)
class RobotWay:
    """On the robot's side."""
    transport: Transport
    control: RobotControl
    reliable: ReliableLink
    """Started where a stream needs it."""


@dataclass(frozen=True)
class OperatorWay:
    """On the operator's side."""
    transport: Transport
    control: OperatorControl
    reliable: ReliableLink
    """Started where a stream needs it."""
    frame_prefix: str
    """Goes before the frames of the robot's messages, see streams.frame_prefix."""
    view_age: Callable[[str, float], Optional[float]]
    """f(stream, now) -> how old what the operator sees of a stream is [s]; None: unknown."""


Way = Union[RobotWay, OperatorWay]


class WayBackStream(Part):
    """One stream of the way back on one side. `start` opens its threads, topics and channels.

    :param name: of the stream in streams.yaml
    :param topic: of this side, resolved: of the service or the action also
    :param settings: {name: value}, checked
    :param table: of the settings that may change
    """
    source: Optional[Source] = None
    """Where its messages come from, or who must listen to them; None: only the other side knows."""

    def __init__(self, name: str, topic: str, settings: Mapping[str, Any], table: Table = MappingProxyType({})) -> None:
        super().__init__()
        self.name, self.topic = name, topic
        self.settings = SettingsStore(table, settings)

    @property
    def heard(self) -> bool:
        """Whether somebody listens to what it publishes."""
        return False

    def start(self) -> None:
        """Begin to exchange messages."""
        raise NotImplementedError

    def stats(self) -> StreamStats:
        """What the stream does and did, for diagnostics."""
        raise NotImplementedError
