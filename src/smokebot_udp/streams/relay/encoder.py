# SPDX-License-Identifier: BSD-3-Clause
"""Relay streams: messages of any type as they are: odometry, battery, gas, tf.

The newest content of each name is sent (contents.py): of each publisher and frame the newest message, of diagnostics
the newest status of each name. Transforms of many publishers go in one message, as many as fit a datagram. Latched
messages are repeated, for lost datagrams and late subscribers, short ones less and less often. Only short messages are
sent before all others, and each repeats the one before (repeats.py); a stream of longer ones has a share of the link,
as images have.
"""
from typing import Any, ClassVar, List, Mapping, Optional

from ...congestion.operating_points import OperatingPoint, rate_points
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import RelaySegment
from ...packed import UNPACKED
from ...udpros.frame import Frame
from ..encoder import Encoded, Encoder, LinkView, Traits
from ..message_types import message_class
from ..parameters import ROBOT
from ..segments import MAIN_PART, room, size_on_air
from .contents import QUEUE, Contents, kept_together, publisher_of
from .parameters import RELAY
from .parts import carried
from .repeats import COPIED_AFTER, COPIED_LOSS, RepeatedMessages

MAX_PROTECTED_DATAGRAMS, MAX_PROTECTED_TOGETHER = 4, 32
"""A stream is protected until the first message that takes more, and until as many leave together."""

LONGEST_REPEAT = 5.0
"""The time until a message of one datagram is repeated doubles with each repeat, up to this. With a repeat_rate of 1 Hz
one of the four copies in 10 s arrives with 94 % where half the datagrams are lost, with 99.8 % where a fifth is [s]."""

MAX_DOUBLINGS = 10

LIMITED_MESSAGES = 20
"""After this many messages in a row at less than the requested rate there is a warning."""


class RelayEncoder(Encoder[Contents]):
    """Sends the newest content of each name at most `rate` times a second; with `latch` the newest message, or all
    contents until now where they make one message.

    :param number: of the first message; a random one, as operators take a restarted node's for old otherwise
    :raises ValueError: where the message type is unknown
    """
    SEGMENTS: ClassVar[Mapping[str, Any]] = {MAIN_PART: RelaySegment}
    LEAST = {'rate': 1.0, 'repeat_rate': 0.2}
    """Minimum rates of a protected stream on a slow link {setting: Hz}."""
    PARAMETERS = {
        **ROBOT, **RELAY,
        'repeat_rate': Parameter(1.0, 'Hz', 'with latch: rate at which the last message is repeated; one that fits a '
                                 'datagram less and less often, down to once in 5 s', above=0.0, most=100.0, live=True),
        'max_share': Parameter(1.0, '', 'largest part of the link that it takes: fewer messages are sent on a slow one',
                               above=0.0, most=1.0, live=True),
    }

    def __init__(self, settings: Mapping[str, Any], number: int = 0) -> None:
        super().__init__(settings)
        self.MESSAGE = message_class(settings['message_type'])
        self.CARRIES = carried(self.MESSAGE)
        self._latch: bool = settings['latch']
        self.traits = Traits(steady=not self._latch, stamped=False, keeps=self._latch, queue_size=QUEUE)
        self.protected = True
        self.replaced = 0
        """Messages that `merge` gave up for newer ones, where what it returned is the same object as before."""
        self._kept: Optional[Contents] = None       # with latch: what is repeated
        self._together = self._latch and kept_together(self.MESSAGE)
        self._repeats = 0               # of the last message, while it takes one datagram
        self._longest_warned = 1        # datagrams of the longest message that was warned of
        self._repeated = RepeatedMessages(number)
        self._limited = 0               # messages in a row that left at less than the requested rate

    def merge(self, waiting: Optional[Contents], message: Any) -> Contents:
        if waiting is None or (self._latch and not self._together):
            waiting = Contents(self.MESSAGE)
        before = waiting.replaced
        self._warn(waiting.add(message, publisher_of(message)))
        self.replaced += waiting.replaced - before
        return waiting

    def encode(self, message: Contents, settings: Settings, link: LinkView) -> Encoded:
        contents = self._with_kept(message) if self._together else message
        frames = self._frames(contents, link)
        if self._latch:
            self._kept = contents       # what cannot be sent is not kept, either
        self.message_size, self._repeats = size_on_air(frames), 0
        self._protect(max(map(len, frames), default=0), sum(map(len, frames)), settings)
        return Encoded(frames)

    def joined(self) -> None:
        self._repeats = 0

    def repeat_period(self, settings: Settings, link: LinkView) -> Optional[float]:
        if not self._latch:
            copied = link.loss >= COPIED_LOSS and self._repeated.pending
            return COPIED_AFTER / link.frame_rate(settings) if copied else None
        shortest: float = max(1.0 / settings['repeat_rate'], 1.0 / settings['rate'])
        doubled: float = shortest * 2 ** min(self._repeats, MAX_DOUBLINGS)
        return max(shortest, min(doubled, LONGEST_REPEAT))

    def repeat(self, settings: Settings, link: LinkView) -> Encoded:
        if not self._latch:
            return Encoded(self._repeated.copies(link) if link.loss >= COPIED_LOSS else ())
        if self._kept is None:
            return Encoded()
        frames = self._frames(self._kept, link)
        self._repeats += max(map(len, frames), default=0) == 1
        return Encoded(frames)

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        if not self._latch or not self.message_size:
            return super().operating_points(rate, settings)
        # what a latched topic costs are the repeats
        repeat_rate = min(settings.requested['repeat_rate'], settings.requested['rate'])
        return [OperatingPoint({'repeat_rate': point.settings['rate']}, point.cost)
                for point in rate_points(repeat_rate, self.message_size, self.LEAST['repeat_rate'])]

    def _with_kept(self, new: Contents) -> Contents:
        contents = Contents(self.MESSAGE)
        for some in (self._kept, new):
            if some is not None:
                self._warn(contents.update(some))
        return contents

    def _warn(self, problem: str) -> None:
        if problem:
            self.warnings.append(problem)

    def _frames(self, contents: Contents, link: LinkView) -> List[Frame]:
        """One frame for each message."""
        longest = room(RelaySegment, link.datagram_size) - UNPACKED
        # of markers, for one, the order matters: those that are kept cross as one message
        whole = self._together and not (contents.cut or contents.empty)
        messages = [contents.merged()] if whole else contents.messages(longest)
        return self._repeated.frames(messages, link, self.protected and not self._latch)

    def _protect(self, datagrams: int, together: int, settings: Settings) -> None:
        """Warn of a long message, and of a stream whose share of the link is too small; a long one is not protected.

        :param datagrams: of the longest message
        :param together: of all messages
        """
        if datagrams > MAX_PROTECTED_DATAGRAMS or together > MAX_PROTECTED_TOGETHER:
            self.protected = False
        if datagrams >= 2 * self._longest_warned:
            self._longest_warned = datagrams
            self.warnings.append('a message takes %d datagrams, and is lost if one of them is' % datagrams)
        limited = not self.protected and settings['rate'] < settings.requested['rate']
        self._limited = self._limited + 1 if limited else 0
        if self._limited == LIMITED_MESSAGES:
            self.warnings.append('its share of the link is too small for all messages: fewer are sent, the newest')
