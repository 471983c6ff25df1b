# SPDX-License-Identifier: BSD-3-Clause
"""Relay streams: messages of any type as they are: odometry, battery, gas, tf.

Transforms are merged: the newest of each pair of frames is sent, those of many publishers in one message, as many as
fit a datagram. Latched messages are repeated, for lost datagrams and late subscribers, short ones less and less often.
Only short messages are sent before all others; a stream of longer ones has a share of the link, as images have.
"""
from typing import Any, ClassVar, List, Mapping, Optional, Sequence

from ...congestion.operating_points import OperatingPoint, rate_points
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import RelaySegment
from ...packed import UNPACKED
from ...udpros.frame import Frame
from ..encoder import Encoder
from ..message_types import message_class
from ..parameters import ROBOT
from ..segments import MAIN_PART, room, size_on_air
from .parameters import RELAY
from .parts import carried, relay_frame
from .transforms import QUEUE, TF_TYPES, TransformSet

MAX_PROTECTED_DATAGRAMS = 4
"""A stream is PROTECTED until the first message that takes more."""

LONGEST_REPEAT = 5.0
"""The time until a message of one datagram is repeated doubles with each repeat, up to this. With a repeat_rate of 1 Hz
one of the four copies in 10 s arrives with 94 % where half the datagrams are lost, with 99.8 % where a fifth is [s]."""

MAX_DOUBLINGS = 10

LIMITED_MESSAGES = 20
"""After this many messages in a row at less than the requested rate there is a warning."""


class RelayEncoder(Encoder[Any]):
    """Sends the newest message at most `rate` times a second.

    What waits is a message, or a TransformSet.

    :raises ValueError: where the message type is unknown
    """
    SEGMENTS: ClassVar[Mapping[str, Any]] = {MAIN_PART: RelaySegment}
    PROTECTED, WHOLE, STAMPED, QUEUE_SIZE = True, True, False, QUEUE
    LEAST = {'rate': 1.0, 'repeat_rate': 0.2}
    PARAMETERS = {
        **ROBOT, **RELAY,
        'repeat_rate': Parameter(1.0, 'Hz', 'with latch: rate at which the last message is repeated; one that fits a '
                                 'datagram less and less often, down to once in 5 s', above=0.0, most=100.0, live=True),
        'max_share': Parameter(1.0, '', 'largest part of the link that it takes: fewer messages are sent on a slow one',
                               above=0.0, most=1.0, live=True),
    }

    def __init__(self, settings: Mapping[str, Any]) -> None:
        super().__init__(settings)
        self.MESSAGE = message_class(settings['message_type'])
        self.CARRIES = carried(self.MESSAGE)
        self.KEEPS, self.STEADY = settings['latch'], not settings['latch']
        self._merges = settings['message_type'] in TF_TYPES
        self._kept: Any = TransformSet() if self._merges else None      # with latch: what is repeated
        self._repeats = 0               # of the last message, while it takes one datagram
        self._longest_warned = 1        # datagrams of the longest message that was warned of
        self._limited = 0               # messages in a row that left at less than the requested rate

    def merge(self, waiting: Optional[Any], message: Any) -> Any:
        return self._with(TransformSet() if waiting is None else waiting, message) if self._merges else message

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Frame]:
        if self.KEEPS:
            message = self._kept = self._with(self._kept, message) if self._merges else message
        frames = self._frames(message, max_datagram_size)
        self.message_size, self._repeats = size_on_air(frames), 0
        self._protect(max(map(len, frames), default=0), settings)
        return frames

    def joined(self) -> None:
        self._repeats = 0

    def repeat_period(self, settings: Settings) -> Optional[float]:
        if not self.KEEPS:
            return None
        shortest: float = max(1.0 / settings['repeat_rate'], 1.0 / settings['rate'])
        doubled: float = shortest * 2 ** min(self._repeats, MAX_DOUBLINGS)
        return max(shortest, min(doubled, LONGEST_REPEAT))

    def repeat(self, settings: Settings, max_datagram_size: int) -> Sequence[Frame]:
        if not self.KEEPS or self._kept is None:
            return ()
        frames = self._frames(self._kept, max_datagram_size)
        self._repeats += max(map(len, frames), default=0) == 1
        return frames

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        if not self.KEEPS or not self.message_size:
            return super().operating_points(rate, settings)
        # what a latched topic costs are the repeats
        repeat_rate = min(settings.requested['repeat_rate'], settings.requested['rate'])
        return [OperatingPoint({'repeat_rate': point.settings['rate']}, point.cost)
                for point in rate_points(repeat_rate, self.message_size, self.LEAST['repeat_rate'])]

    def _with(self, transforms: TransformSet, message: Any) -> TransformSet:
        """A set with the transforms of a message, or of another set, added."""
        try:
            transforms.add(message)
        except ValueError as error:
            self.warnings.append(str(error))
        return transforms

    def _frames(self, content: Any, max_datagram_size: int) -> List[Frame]:
        """One frame for each message."""
        longest = room(RelaySegment, max_datagram_size) - UNPACKED
        messages = content.messages(self.MESSAGE, longest) if self._merges else [content]
        return [relay_frame(message, max_datagram_size) for message in messages]

    def _protect(self, datagrams: int, settings: Settings) -> None:
        """Warn of a long message, and of a stream whose share of the link is too small; a long one is not PROTECTED.

        :param datagrams: of the longest message
        """
        if datagrams > MAX_PROTECTED_DATAGRAMS:
            self.PROTECTED = False
        if datagrams >= 2 * self._longest_warned:
            self._longest_warned = datagrams
            self.warnings.append('a message takes %d datagrams, and is lost if one of them is' % datagrams)
        limited = not self.PROTECTED and settings['rate'] < settings.requested['rate']
        self._limited = self._limited + 1 if limited else 0
        if self._limited == LIMITED_MESSAGES:
            self.warnings.append('its share of the link is too small for all messages: fewer are sent, the newest')
