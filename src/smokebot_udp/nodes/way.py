# SPDX-License-Identifier: BSD-3-Clause
"""What the streams of the way back share with the other parts of their node: commands, reliable relays, services and
actions, see way_back.py.
"""
from dataclasses import dataclass
from typing import Any, Callable, Optional

from ..transport import Transport
from .operator_control import OperatorControl
from .outbox import Outbox
from .robot_control import RobotControl


@dataclass(frozen=True)
class RobotWay:
    """On the robot's side."""
    transport: Transport
    outbox: Outbox
    control: RobotControl
    reliable: Any
    """reliable_link.ReliableLink; None where no stream needs it."""
    report: Callable[[str], None]
    """f(problem)"""


@dataclass(frozen=True)
class OperatorWay:
    """On the operator's side."""
    transport: Transport
    control: OperatorControl
    reliable: Any
    """reliable_link.ReliableLink; None where no stream needs it."""
    report: Callable[[str], None]
    """f(problem)"""
    frame_prefix: str
    """Goes before the frames of the robot's messages, see streams.frame_prefix."""
    view_age: Callable[[str, float], Optional[float]]
    """f(stream, now) -> how old what the operator sees of a stream is [s]; None: unknown."""
