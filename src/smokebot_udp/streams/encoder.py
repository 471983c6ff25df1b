# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of a kind of stream: messages to frames, without threads, topics or a clock.

A kind derives from Encoder. The runner (nodes/robot_stream.py) owns the subscription, the publisher, the worker thread
and the settings; it passes them in and sends what comes out.
"""
from typing import Any, ClassVar, Dict, Generic, List, Mapping, Optional, Sequence, TypeVar, Union

from ..congestion.operating_points import OperatingPoint
from ..mission.parameters import Parameter
from ..mission.settings import Settings
from ..udpros.frame import Frame
from .parameters import ROBOT

Message = TypeVar('Message')
Payload = Union[Frame, Any]
"""A Frame, or a message that is sent as it is."""


class Encoder(Generic[Message]):
    """Makes frames of the messages of one stream. One thread at a time calls it.

    :param settings: {name: value} at the start, of PARAMETERS, checked each
    :raises ValueError: where they contradict each other
    """
    MESSAGE: ClassVar[Any] = None
    """Class of the source's messages."""
    SEGMENT: ClassVar[Any] = None
    """Class of the messages on the wire."""
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = ROBOT
    """What streams.yaml may say of the robot's side of this kind."""
    PROTECTED: ClassVar[bool] = False
    """Whether its messages leave at once, before all that waits; `encode` returns messages then, not frames."""
    STEADY: ClassVar[bool] = True
    """Whether a silent source is a fault."""
    STAMPED: ClassVar[bool] = True
    """Whether segments belong together by their stamp, so that each message needs one of its own."""
    KEEPS: ClassVar[bool] = False
    """Whether messages are encoded even where nobody listens yet, for who comes late."""
    QUEUE_SIZE: ClassVar[int] = 1
    """Of the subscription."""
    DERIVED: ClassVar[Any] = None
    """Class of the messages that `derive` makes for the robot's own use; None: it makes none."""
    LEAST: ClassVar[Dict[str, float]] = {}
    """Rates of a protected stream below which a slow link does not push it {setting: Hz}."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.check(settings)

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        """Whether settings go together.

        :raises ValueError: naming the settings and their values
        """

    def merge(self, waiting: Optional[Message], message: Message) -> Message:
        """What waits to be encoded when a message comes; waiting: what waited before, None: nothing."""
        return message

    def derive(self, message: Message, settings: Settings) -> Any:
        """What is published on the robot, and then encoded; the message itself where DERIVED is None.

        :raises ValueError: where the message is wrong, in words
        """
        return message

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Payload]:
        """The payloads that carry a message, in sending order; empty where nothing new is to be sent.

        :param max_datagram_size: [byte of UDP payload]
        :raises ValueError: where the message is wrong, in words
        """
        raise NotImplementedError

    def repeat_period(self, settings: Settings) -> Optional[float]:
        """How often `repeat` is due [s]; None: never."""
        return None

    def repeat(self, settings: Settings, max_datagram_size: int) -> Sequence[Payload]:
        """What is sent again, for what was lost and who came late."""
        return ()

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        """What the stream can be turned down to, the cheapest first; empty where nothing is known of its messages yet.

        :param rate: of the source, or as requested where that is slower [Hz]
        """
        return []

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        """The settings of an operating point, improved by bandwidth that is left over.

        :param point: {name: value} of an OperatingPoint
        :param spare: [byte/s]
        """
        return dict(point)
