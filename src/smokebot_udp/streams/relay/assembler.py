# SPDX-License-Identifier: BSD-3-Clause
"""Relayed messages, published as they are; latched ones together with all earlier ones, where they make one message."""
from typing import Any, Iterable, Iterator, Mapping, Optional, Sequence

from ...msg import RelaySegment
from ...serialised import deserialised
from ..assembler import Assembled, Assembler, Clock, no_clock
from ..message_types import message_class
from ..parameters import OPERATOR
from ..segments import MAIN_PART
from .contents import QUEUE, Contents, kept_together, stamp_of
from .parameters import RELAY
from .parts import PartJoiner, carried
from .repeats import MessageOrder


class RelayAssembler(Assembler[None, Assembled]):
    """Forwards each message.

    Of latched messages subscribers receive only the last one, so transforms, for one, are merged into one message.
    """
    SEGMENTS = {MAIN_PART: RelaySegment}
    FORWARDS, QUEUE_SIZE = True, QUEUE
    PARAMETERS = {**OPERATOR, **RELAY}

    def __init__(self, settings: Mapping[str, Any], clock: Clock = no_clock) -> None:
        super().__init__(settings, clock)
        self.MESSAGE = message_class(settings['message_type'])
        self.CARRIES = carried(self.MESSAGE)
        self.LATCH, self.STEADY = settings['latch'], not settings['latch']
        self._merges = self.LATCH and kept_together(self.MESSAGE)
        self._parts = PartJoiner(self.MESSAGE)
        self.dropped = self._parts.dropped
        self._order = MessageOrder(self.dropped)
        self._contents = Contents(self.MESSAGE)
        self._last: Any = None      # message with all of them

    def join(self, segment: Any) -> Sequence[Any]:
        different = self.dropped['checksum']
        data = self._parts.add(segment)
        if self.dropped['checksum'] > different:
            self.warnings.append('a message is not a %s as it is installed here' % self.MESSAGE._type)
        return [] if data is None else list(self._messages(self._order.add(segment.number, data, segment.before)))

    def _messages(self, found: Iterable[bytes]) -> Iterator[Any]:
        for data in found:
            try:
                yield deserialised(self.MESSAGE, data)
            except ValueError:
                self.dropped['message'] += 1

    def forward(self, message: Any) -> Optional[Assembled]:
        if self._merges:
            message = self._merged(message)
            if message == self._last:
                return None     # refresh cycles repeat it
            self._last = message
        stamp = stamp_of(message)
        return Assembled(message, 0 if stamp is None else stamp.to_nsec(), None)

    def _merged(self, message: Any) -> Any:
        problem = self._contents.add(message)
        if problem:
            self.warnings.append(problem)
        return self._contents.merged()
