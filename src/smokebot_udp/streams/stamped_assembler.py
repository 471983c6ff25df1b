# SPDX-License-Identifier: BSD-3-Clause
"""Assemblers whose segments make one message for each stamp of a source: images, clouds, scans."""
from types import SimpleNamespace
from typing import Any, ClassVar, Mapping, Optional, Tuple, TypeVar

import numpy as np
from genpy import Time
from std_msgs.msg import Header

from ..arrays import BoolArray, Records
from ..mission.parameters import Parameter
from ..mission.settings import Settings
from .assembler import Assembled, Assembler, Clock, no_clock
from .frame_assembler import MAX_WAIT, Frame, FrameAssemblers, PartialFrame
from .parameters import OPERATOR
from .segments import ARRIVAL, MAIN_PART, frames_of, head_of, nanoseconds, picked, same_head

Partial = TypeVar('Partial', bound=PartialFrame)
Result = TypeVar('Result', bound=Assembled)


class StampedAssembler(Assembler[Frame[Partial], Result]):
    """Makes one message of each stamp's segments.

    A kind derives from it, with HEADS, `begin`, `parts` and `assemble`. All segments of a message are of one part.
    """
    HEADS: ClassVar[Mapping[str, Tuple[str, ...]]] = {}
    """{part: the fields that are equal in all segments of one stamp, besides the header}"""
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **OPERATOR,
        'max_wait': Parameter(MAX_WAIT, 's', 'longest time from the first segment of a message until the message is '
                              'published', above=0.0, most=60.0, live=True),
    }

    def __init__(self, settings: Mapping[str, Any], clock: Clock = no_clock) -> None:
        super().__init__(settings, clock)
        self._frames = FrameAssemblers(self.begin, settings['max_wait'], self.began)
        self.dropped = self._frames.dropped

    def begin(self, head: SimpleNamespace) -> Partial:
        """An empty frame. Nothing else may change: the head may be forged.

        :param head: stamp, frame_id, arrival [ns] and HEADS of its segments, see segments.head_of, and their `part`
        :raises ValueError: the head is impossible
        """
        raise NotImplementedError

    def began(self, head: SimpleNamespace) -> None:
        """Note that a frame begins: a segment fits it.

        :param head: as of `begin`
        """

    def parts(self, records: Records, part: str) -> Tuple[Any, ...]:
        """The arguments of PartialFrame.add for (m,) segments of one part and layout."""
        raise NotImplementedError

    def configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        self._frames.configure(max_wait=settings['max_wait'])

    def receive(self, records: Records, mask: BoolArray, now: float, part: str = MAIN_PART) -> None:
        rows = np.flatnonzero(mask)
        if not len(rows):
            return
        for of_frame in frames_of(records, rows):
            head = head_of(records[of_frame[0]], self.SEGMENTS[part], (ARRIVAL, *self.HEADS[part]))
            head.part, head.arrival = part, nanoseconds(head.arrival)
            same = same_head(records, of_frame, self.HEADS[part])
            self.dropped['contradiction'] += int(np.count_nonzero(~same))
            self._frames.add(head, self.parts(picked(records, of_frame[same]), part), now, head.arrival or head.stamp)

    def deadline(self) -> Optional[float]:
        return self._frames.deadline()

    def poll(self, now: float) -> Optional[Frame[Partial]]:
        return self._frames.poll(now)


def header_of(head: SimpleNamespace) -> Header:
    """The std_msgs/Header of a segment's head."""
    return Header(stamp=Time(*divmod(head.stamp, 10 ** 9)), frame_id=head.frame_id)
