# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of a kind of stream: segments in, messages out, without threads, topics or a clock.

A kind derives from Assembler. The runner (nodes/operator_stream.py) owns the subscription, the publishers, the worker
thread and the settings:

    receive(records, ...)    under its lock, for each batch of segments, in the transport's thread: it takes no time
    deadline(), poll(now)    under its lock, in the worker thread
    work()                   likewise, where `poll` has nothing; then Work.do without the lock, and Work.done under it
    assemble(finished, ...)  without the lock, in the worker thread, once for each result of `poll`
    settle(finished, ...)    likewise, after the message is published

A kind whose messages need no work (FORWARDS) implements `join` and `forward` instead, called in the transport's thread.
"""
import collections
from dataclasses import dataclass, field
from typing import (
    Any,
    Callable,
    ClassVar,
    Counter,
    FrozenSet,
    Generic,
    List,
    Mapping,
    Optional,
    Protocol,
    Sequence,
    TypeVar,
)

from ..arrays import BoolArray, Records
from ..image_error import ImageError
from ..mission.parameters import Parameter
from ..mission.settings import Settings
from .held import Holding
from .held_schedule import COALESCED
from .parameters import OPERATOR
from .segments import MAIN_PART

Clock = Callable[[], float]


def no_clock() -> float:
    """A clock by which no work takes any time."""
    return 0.0


@dataclass
class Assembled:
    """A message to be published."""
    message: Any
    stamp: int
    """Stamp of the source, by the robot's clock; 0: unknown [ns]."""
    completeness: Optional[float]
    """Received share of it, 0..1; None: unknown."""
    arrival: int = field(default=0, init=False)
    """When it came to robot_sender, by the robot's clock, where its stamp does not say how old it is; else 0 [ns]."""
    changed: Optional[float] = field(default=None, init=False)
    """Share of an image's cells that differ from the image before, 0..1; None: not compared, or no image."""
    camera_info: Optional[Callable[[], Any]] = field(default=None, init=False)
    """f() -> sensor_msgs/CameraInfo of an image without its header, or None while it is not known; None: none is
    wanted."""
    error: Optional[ImageError] = field(default=None, init=False)
    """Error of an image that was coded with loss; None: what was received is exact, or, of video, nothing is known."""


class Work(Protocol):
    """What takes time before a message can be finished, as decoding does."""

    def do(self) -> None:
        """Do it, without the lock; in the thread that calls `poll`, `work` and `assemble`."""

    def done(self) -> None:
        """Take the result, under the lock."""


Finished = TypeVar('Finished')
"""What `poll` returns: the received parts of one message. Nothing is added to it any more."""
Result = TypeVar('Result', bound=Assembled)


class Assembler(Generic[Finished, Result]):
    """Makes messages of the segments of one stream.

    :param settings: {name: value} at the start, of PARAMETERS, checked
    :param clock: a steady clock that measures how long work takes [s]
    :raises ValueError: the settings are impossible for this kind
    """
    MESSAGE: Any = None
    """Class of the messages that come out."""
    SEGMENTS: ClassVar[Mapping[str, Any]] = {}
    """{part: class of its messages on the wire}, see segments.wire_topic."""
    CARRIES: str = ''
    """Type and md5 sum of the messages that segments carry as they are, see transport.Transport; empty: none."""
    COMPILED: ClassVar[FrozenSet[str]] = frozenset()
    """Parts whose segments need the compiled codec. The runner discards them until it is loaded."""
    DECODED: ClassVar[FrozenSet[str]] = frozenset()
    """Parts whose segments need a decoder of video. The runner discards them where there is none; otherwise it passes
    one to the constructor, as `decoder`."""
    HOLDS_SHOWN: ClassVar[bool] = False
    """Whether `holding` is reported after each call of `assemble`; it always is after Work."""
    REPORT_INTERVAL: ClassVar[float] = COALESCED
    """Reports of what is held are this far apart at least [s]."""
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = OPERATOR
    """What streams.yaml may set for the operator's side of this kind."""
    LATCH: bool = False
    """Whether late subscribers receive the last message."""
    STEADY: bool = True
    """Whether silence is a fault."""
    QUEUE_SIZE: ClassVar[int] = 2
    """Queue size of the publisher. Only the newest of most messages counts."""
    FORWARDS: ClassVar[bool] = False
    """Whether messages are published in the transport's thread. Then only `configure`, `join`, `forward` and `problem`
    are called."""

    def __init__(self, settings: Mapping[str, Any], clock: Clock = no_clock) -> None:
        self._clock = clock
        self.dropped: Counter[str] = collections.Counter()
        """{reason: count} of the segments that changed nothing."""
        self.warnings: List[str] = []
        """For the log; the runner removes them."""

    def configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        """Apply changed settings; under the runner's lock.

        :param changed: {name: value} of the settings whose effective value differs from before, never empty
        """

    def subscribed(self) -> Sequence[str]:
        """The parts of SEGMENTS that are received."""
        return list(self.SEGMENTS)

    def receive(self, records: Records, mask: BoolArray, now: float, part: str = MAIN_PART) -> None:
        """Sort a batch of segments of one part.

        :param records: (n,) structured array of segments, see udpros.records; valid during the call only
        :param mask: (n,) which of them are good
        :param now: by a steady clock [s]
        :param part: of SEGMENTS
        """
        raise NotImplementedError

    def deadline(self) -> Optional[float]:
        """When `poll` or `work` returns something next, unless more is received; None: never. In the past: at once [s].
        """
        raise NotImplementedError

    def poll(self, now: float) -> Optional[Finished]:
        """The next finished one, in order of time; None: nothing is finished yet."""
        raise NotImplementedError

    def work(self) -> Optional[Work]:
        """What is to be done now; None: nothing."""
        return None

    def assemble(self, finished: Finished, settings: Settings, still: bool, now: float) -> Optional[Result]:
        """Make the message; None if it equals the one published last.

        :param still: whether the robot stands still
        """
        raise NotImplementedError

    def settle(self, finished: Finished, assembled: Result, settings: Settings, now: float) -> None:
        """Do the work that can wait until the message is published; may set ``assembled.changed``."""

    def join(self, segment: Any) -> Sequence[Any]:
        """The messages that a segment (a message of a class of SEGMENTS) completes, in order."""
        raise NotImplementedError

    def forward(self, message: Any) -> Optional[Result]:
        """What is published of a message from `join`; None if it equals the one published last."""
        raise NotImplementedError

    def holding(self) -> Optional[Holding]:
        """What the robot need not send again, or may build on; None: nothing is reported. Under the runner's lock."""
        return None

    def ages(self, now: float) -> Optional[Any]:
        """A nav_msgs/OccupancyGrid of the ages of what is shown [s]; None: nothing is. Under the runner's lock."""
        return None

    def problem(self, settings: Settings, now: float) -> Optional[str]:
        """What deserves a warning in diagnostics now; None: nothing. Any thread may ask."""
        return None
