# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of a kind of stream: messages to frames, without threads, topics or a clock.

To add a kind, derive from Encoder. The runner (nodes/robot_stream.py) owns the subscription, the publisher, the worker
thread and the settings; it passes settings in and sends the frames that come out.
"""
import collections
import math
from dataclasses import dataclass
from typing import (
    Any,
    Callable,
    ClassVar,
    Collection,
    Deque,
    Dict,
    Generic,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    TypeVar,
)

from .. import traffic
from ..congestion.operating_points import OperatingPoint, rate_points
from ..mission.parameters import Parameter
from ..mission.settings import Settings
from ..udpros.datagram import DEFAULT_MAX_DATAGRAM_SIZE
from ..udpros.frame import Frame
from .held import Holding
from .outlook import Outlook
from .parameters import ROBOT
from .segments import MAIN_PART, MAX_SOURCES

Message = TypeVar('Message')
"""What `merge` returns and `encode` takes: mostly a ROS message."""


@dataclass(frozen=True)
class Traits:
    """What a stream is like, as long as it runs."""
    steady: bool = True
    """Whether a silent source is a fault."""
    stamped: bool = True
    """Whether segments are assigned to their message by its stamp, so that each message needs a stamp of its own."""
    keeps: bool = False
    """Whether messages are encoded even where nobody is subscribed, for late subscribers."""
    reencodes: bool = False
    """Whether the last message is encoded again when settings change; `encode` returns no frames where nothing does."""
    foresees: bool = False
    """Whether `outlook`, `waiting` and `unsent` of LinkView are used: they cost some computing for each report."""
    queue_size: int = MAX_SOURCES
    """Queue size of the subscription. Where messages of several sources come together, all of them are to be seen."""
    traffic: int = traffic.SENSORS
    """How networks are asked to serve its datagrams, see traffic.py."""


class LinkView(NamedTuple):
    """What an encoder may know of the link. Immutable: the runner makes one for each call."""
    datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE
    """Maximum size of the datagrams of frames [byte of UDP payload]."""
    longest_datagram: int = 0
    """Size of the longest datagram that passes, however slow the link is [byte of UDP payload]."""
    outlook: Outlook = Outlook()
    """What to expect of the link."""
    waiting: float = 0.0
    """How long what is left of the last message takes to leave at what the stream may use [s]."""
    unsent: bool = False
    """Whether no datagram of the last message has left, and the next one may take its place."""
    source_rate: Optional[float] = None
    """Rate of the source as measured, however many of its messages are encoded; None: it is not known [Hz]."""
    loss: float = 0.0
    """Packet-loss ratio as reported, 0..1; NaN: it is not known."""
    afford: Callable[[int, bool], bool] = lambda size, datagram: True
    """f(size [byte], datagram): whether this much may be sent to protect messages now; then it counts as sent.
    `datagram`: it takes datagrams of its own, and can wait. See RepetitionBudget."""
    heard: Callable[[str], bool] = lambda part: True
    """Whether all operators that receive the stream receive this part of it now."""
    operators: Callable[[str], Collection[str]] = lambda part: ()
    """Names of the operators that this part of the stream is sent to now."""
    why_not: Callable[[str, str], str] = lambda part, operator: 'does not receive it'
    """Why this part of the stream is not sent to an operator, in words."""

    def frame_rate(self, settings: Mapping[str, Any]) -> float:
        """Maximum rate of the messages that are sent [Hz].

        :param settings: {name: value} with `rate`
        """
        rate: float = settings['rate']
        return min(rate, self.source_rate or math.inf)


class Sizing(NamedTuple):
    """What decided the size of a message, for the log and the trace."""
    coding: str
    granted: float
    """What it might have taken on the air; inf: there was no limit [byte]."""
    used: int
    """What it takes on the air [byte]."""
    bound: str
    """What decided, for images a value of image_size.Bound."""
    error: float
    """Its rms error once all of it has come, as the encoder estimates it [count]; NaN: it does not."""


class Encoded(NamedTuple):
    """What is to be sent of a message."""
    frames: Sequence[Frame] = ()
    """In sending order, of one part; made anew each time, because earlier ones may not have left yet. Empty: there is
    nothing new."""
    beside: Sequence[Frame] = ()
    """Frames of other parts. They leave at once, before `frames`."""
    base: int = 1
    """Datagrams that show something of it, at least: they leave before the rest of others."""
    backlog: Optional[float] = None
    """A newer message waits for the rest of this one if that leaves within this time; None: as the outbox decides [s].
    """
    wished: float = 0.0
    """As Demand.wished [byte/s]."""
    sizing: Optional[Sizing] = None
    """None: its kind says nothing."""


class Encoder(Generic[Message]):
    """Makes frames of the messages of one stream.

    `encode` and `repeat` are called by one thread, `merge` by one thread at a time, all others by any thread.

    :param settings: {name: value} of PARAMETERS at the start, each checked
    :raises ValueError: where they contradict each other
    """
    MESSAGE: Any = None
    """Class of the source's messages."""
    ACCEPTED: ClassVar[Sequence[Any]] = ()
    """Classes that the source's messages may have, MESSAGE the first of them; empty: only MESSAGE."""
    SEGMENTS: ClassVar[Mapping[str, Any]] = {}
    """{part: class of its messages on the wire}, see segments.wire_topic; a frame belongs to the part of its class."""
    CARRIES: str = ''
    """Type and md5 sum of the messages that segments carry as they are, see transport.Transport; empty: none."""
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = ROBOT
    """Settings of the robot's side of this kind."""
    traits = Traits()
    protected = False
    """Whether messages are sent at once, before everything that waits in the outbox; each has a frame of its own then.
    `encode` may change it to False."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.check(settings)
        self.message_size: Optional[float] = None
        """Size of the last message on the air; None: nothing was encoded yet [byte]."""
        self.warnings: Deque[str] = collections.deque(maxlen=16)
        """For the log: problems of messages that were encoded nevertheless. The runner removes them."""
        self.problem: Optional[str] = None
        """What is missing for the messages now, in words, such as a transform."""

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        """Check that settings do not contradict each other.

        :param settings: {name: value} of PARAMETERS, each checked
        :raises ValueError: naming the settings and their values
        """

    def parts(self, settings: Settings) -> Sequence[str]:
        """The parts that messages may be sent on with these settings."""
        return [MAIN_PART]

    def sources(self, settings: Mapping[str, Any]) -> Mapping[str, Any]:
        """{topic: class of its messages}: what is subscribed beside `robot_topic`. Their messages are merged, too.

        :param settings: {name: value} of PARAMETERS
        """
        return {}

    def takes(self, message: Any) -> bool:
        """Take a message of `sources` that accompanies those of the source: it is neither merged nor counted.

        :return: whether it is one
        """
        return False

    def merge(self, waiting: Optional[Message], message: Any) -> Optional[Message]:
        """What waits to be encoded after a message has arrived; unless a kind overrides this, the newest message.

        :param waiting: what waited before; None: nothing
        :raises ValueError: saying what is wrong with the message
        """
        newest: Message = message
        return newest

    def derive(self, message: Any, settings: Settings) -> Any:
        """What is encoded of a message from `merge`: the message itself, unless a kind makes another one of it, which
        is published on the robot as well.

        :raises ValueError: saying what is wrong with the message
        """
        return message

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        """What is to be sent of a message.

        :param message: from `derive`
        :raises ValueError: saying what is wrong with the message
        """
        raise NotImplementedError

    def repeat_period(self, settings: Settings, link: LinkView) -> Optional[float]:
        """How long after something was sent `repeat` is called [s]; None: never.

        Asked after each call of `encode`, `repeat` and `held`. Any thread may ask.
        """
        return None

    def repeat(self, settings: Settings, link: LinkView) -> Encoded:
        """What is sent again, for lost datagrams and late subscribers, or the next frames of a kind that sends little
        by little. Not called while frames of the last message are still leaving."""
        return Encoded()

    def joined(self) -> None:
        """There is a new subscriber; any thread. `repeat` follows at once where there is something to repeat."""

    def held(self, operator: str, holding: Holding) -> None:
        """Take an operator's report of what it holds. Unless a kind overrides this, it says nothing.

        :param operator: its name, one of those that the stream is sent to
        """

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        """The operating points of the stream, the cheapest first; empty where no message was encoded yet.

        Unless a kind overrides this, only the rate is reduced.

        :param rate: of the source, or the requested rate if that is lower [Hz]
        """
        return rate_points(rate, self.message_size) if self.message_size else []

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        """Improve the settings of an operating point by bandwidth that is left over.

        :param point: {name: value} of an OperatingPoint
        :param spare: [byte/s]
        """
        return dict(point)
