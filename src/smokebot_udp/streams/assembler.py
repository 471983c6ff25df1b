# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of a kind of stream: segments to messages, without threads, topics or a clock.

A kind derives from Assembler. The runner (nodes/operator_stream.py) owns the subscription, the publishers, the worker
thread and the settings. It calls `receive`, `deadline` and `poll` under its lock, `assemble` and `settle` outside it.
"""
import collections
from dataclasses import dataclass
from typing import Any, ClassVar, Counter, Generic, List, Mapping, Optional, TypeVar

from ..arrays import BoolArray, Records
from ..mission.parameters import Parameter
from ..mission.settings import Settings
from .parameters import OPERATOR

Finished = TypeVar('Finished')
"""What `poll` returns: all that came of one message, nothing more is added to it."""


@dataclass
class Assembled:
    """A message that is to be published."""
    message: Any
    stamp: int
    """Of the source, by the robot's clock; 0: unknown [ns]."""
    completeness: Optional[float] = None
    """Share of it that was received, 0..1; None: unknown."""
    changed: Optional[float] = None
    """Of images: the share of their cells that differ from the image before; None: they could not be compared."""


class Assembler(Generic[Finished]):
    """Makes messages of the segments of one stream.

    :param settings: {name: value} at the start, of PARAMETERS, checked each
    """
    MESSAGE: ClassVar[Any] = None
    """Class of the messages that come out."""
    SEGMENT: ClassVar[Any] = None
    """Class of the messages on the wire."""
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = OPERATOR
    """What streams.yaml may say of the operator's side of this kind."""
    LATCH: ClassVar[bool] = False
    """Whether the last message is kept for subscribers that come late."""
    STEADY: ClassVar[bool] = True
    """Whether silence is a fault."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """{reason: count} of the segments that changed nothing."""

    def configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        """Other settings are in effect; changed: {name: value} of those that differ."""

    def receive(self, records: Records, mask: BoolArray, now: float) -> None:
        """Sort a batch of segments.

        :param records: (n,) structured array of segments, see udpros.records; valid during the call only
        :param mask: (n,) which of them are good
        :param now: by a steady clock [s]
        """
        raise NotImplementedError

    def deadline(self) -> Optional[float]:
        """When `poll` will have something at the latest; None: not before more is received [s]."""
        raise NotImplementedError

    def poll(self, now: float) -> List[Finished]:
        """What is finished now, in order."""
        raise NotImplementedError

    def assemble(self, finished: Finished, settings: Settings, still: bool, now: float) -> Optional[Assembled]:
        """Make the message; None where it is what was published last.

        :param still: whether the robot stands still
        """
        raise NotImplementedError

    def settle(self, finished: Finished, assembled: Assembled, settings: Settings, now: float) -> None:
        """What is left to do once the message is published."""
