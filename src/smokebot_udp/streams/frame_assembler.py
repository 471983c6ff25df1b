# SPDX-License-Identifier: BSD-3-Clause
"""Which frame is finished when: a jitter buffer of one frame in progress, without clock or ROS (D6.3, section 4.2).

A frame is the segments of one message: they have the same frame_id and stamp, and arrival, which tells messages apart
whose stamps do not. Sources that differ in their frame_id are assembled each for itself. A frame is finished when all
that was sent of it has been received; when what is still missing is no longer expected, or would not change anything
(frame_end.py); when a segment of a newer frame is received; or max_wait after its first segment. Segments of a finished
frame are late, or not needed if it was complete, and change nothing but how long the next frame is waited for.

Where segments come by two paths, or are reordered by one, those of a frame may come after the first one of the next.
How long after is learnt from two frames in a row. An incomplete frame stays open for as long beside the next one. What
happens to one frame is an exception, for which the others do not wait.

A frame is finished once: what is received later does not bring out a better version of it. Two messages of one stamp
would look like two images to whoever counts or records them.
"""
import collections
import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Callable, Counter, Deque, Dict, Generic, Optional, Protocol, Tuple, TypeVar

import numpy as np

from ..arrays import BoolArray, IntArray
from ..frame_names import frame_name
from .frame_end import LEAST_MARGIN, FrameEnd
from .segments import MAX_SOURCES

RESTART = 2.0
"""A stamp that is older than the newest one by more is not late: the source's clock was set back, or a recording
starts again [s]."""

MAX_REORDERING = 0.3
"""Nor is any older stamp where no other segment was accepted for this long: no link reorders by so much. The clock was
set back by less, or a short recording starts again [s]."""

MAX_OVERLAP = 0.1
"""A frame stays open beside the next one for this long at most [s]."""

OVERLAP_GAIN = 1 / 8
"""Weight of the newest frames where segments came less late, as of frame_end.GAIN. Later ones count at once."""

MAX_WAIT = 0.2
"""How long images, clouds and the like are waited for, unless an operator changes max_wait. Encoders that spread a
message over time know by it how long it may take [s]."""

MAX_FINISHED = 2
"""Finished frames that wait to be taken, unless a kind says otherwise; newer ones replace the oldest."""


class PartialFrame(Protocol):
    """What was received of a frame."""

    @property
    def complete(self) -> bool:
        """Whether all that was sent of it was received, or can be restored."""

    @property
    def completeness(self) -> float:
        """Received share, 0..1."""

    @property
    def awaited(self) -> int:
        """The place, in the order of sending, of the missing segment that matters last: where neither it nor a missing
        one before it comes, those after it change nothing. Not asked of a complete frame."""

    def places(self, numbers: IntArray) -> IntArray:
        """The places of segments in the order of sending. By any thread.

        :param numbers: (m,) int, the first of the arguments of `add`
        :return: (m,) int, from 0 on; -1: there is no such segment
        """

    def add(self, *parts: Any) -> BoolArray:
        """Add m segments; (m,) which of them fit. The others are dropped."""


Partial = TypeVar('Partial', bound=PartialFrame)


@dataclass
class Frame(Generic[Partial]):
    """A frame, in progress or finished."""
    head: SimpleNamespace
    """The fields that all of its segments repeat, see segments.head_of."""
    content: Partial
    began: float
    """When its first segment was received [s]."""
    latest: float
    """When the last one so far was received [s]."""
    given_up: float = math.inf
    """When what is missing is no longer expected [s]."""
    order: int = 0
    """See FrameAssembler.add."""


class FrameAssembler(Generic[Partial]):
    """Sorts segments into frames; one is in progress at a time.

    :param begin: f(head) -> PartialFrame, empty; raises ValueError if the head is impossible
    :param max_wait: may be changed at any time [s]
    :param began: f(head), called for each frame that begins, as a segment fits it; heads alone may be forged
    :param dropped: to be added to; None: it has its own
    """

    def __init__(self, begin: Callable[[SimpleNamespace], Partial], max_wait: float,
                 began: Callable[[SimpleNamespace], None] = lambda head: None,
                 dropped: Optional[Counter[str]] = None) -> None:
        self.max_wait = max_wait
        self.max_finished = MAX_FINISHED
        """May be changed at any time."""
        self.dropped: Counter[str] = collections.Counter() if dropped is None else dropped
        """Segments that changed nothing, by reason: late, not needed, contradiction, impossible head. Frames that were
        finished, but newer ones came before they were taken: overtaken frame."""
        self._begin, self._began = begin, began
        self._newest: Optional[int] = None      # order of the frame in progress, or of the last one finished
        self._surplus = 'late'                  # what further segments of the last finished frame are
        self._accepted = -math.inf              # when a segment was accepted last
        self._current: Optional[Frame[Partial]] = None
        self._last: Optional[Frame[Partial]] = None     # the frame in progress, or the last one finished
        self._before: Optional[Frame[Partial]] = None   # the one before that
        self._is_open = False       # whether that one still waits
        self._overlap = 0.0         # how long that is worth while [s]
        self._seen_overlaps = 0.0, 0.0      # by how much the last two frames before ended later [s]
        self._end = FrameEnd()
        self._finished: Deque[Frame[Partial]] = collections.deque()

    @property
    def busy_until(self) -> float:
        """Until when a frame is in progress, or a segment of the last one may come [s]."""
        return self._accepted + MAX_REORDERING if self.deadline() is None else math.inf

    def deadline(self) -> Optional[float]:
        """When `poll` returns a frame next, unless more is added; None: never [s]."""
        if self._finished:
            return -math.inf
        waiting = (self._before if self._is_open else None, self._current)
        return min((self._end_of(frame) for frame in waiting if frame is not None), default=None)

    def _end_of(self, frame: Frame[Partial]) -> float:
        """When a frame is finished, unless more of it comes [s]."""
        return min(frame.began + self.max_wait, frame.given_up)

    def poll(self, now: float) -> Optional[Frame[Partial]]:
        """The oldest finished frame that was not returned before; None if there is none."""
        deadline = self.deadline()
        if deadline is None or now < deadline:
            return None
        if not self._finished:
            if self._is_open and self._before is not None and now >= self._end_of(self._before):
                self._close()
            else:
                self._finish()
        return self._finished.popleft()

    def add(self, head: SimpleNamespace, parts: Tuple[Any, ...], now: float, order: Optional[int] = None) -> None:
        """Take m segments of one frame.

        :param head: the fields that they repeat
        :param parts: arguments of PartialFrame.add; the first has length m
        :param now: by any steady clock [s]
        :param order: a time that identifies the frame and grows from frame to frame; None: its stamp [ns]
        """
        count, order = len(parts[0]), head.stamp if order is None else order
        older = self._newest is not None and 0 < self._newest - order < RESTART * 1e9
        if older and now - self._accepted <= MAX_REORDERING:
            self._add_older(head, parts, now, order)
        elif order != self._newest:
            self._add_new(head, parts, now, order)
        elif self._last is not None and self._last.head != head:
            self.dropped['contradiction'] += count
        elif self._current is None:
            self.dropped[self._surplus] += count
            self._learn(parts, now)
        else:
            good = self._fit(self._current.content, parts)
            if good.any():
                self._expect(self._current, parts, good, now)

    def _add_new(self, head: SimpleNamespace, parts: Tuple[Any, ...], now: float, order: int) -> None:
        try:
            content = self._begin(head)
        except ValueError:
            self.dropped['impossible head'] += len(parts[0])
            return
        # only segments that fit start a frame: forged ones must not finish the one in progress
        good = self._fit(content, parts)
        if good.any():
            self._leave_open(now)
            self._newest = order
            self._before, self._current = self._last, Frame(head, content, now, now, order=order)
            self._last = self._current
            self._end.begin()
            self._began(head)
            self._expect(self._current, parts, good, now)

    def _leave_open(self, now: float) -> None:
        """A new frame begins: the one in progress waits a little longer where that is worth while."""
        if self._is_open:
            self._close()
        lasting = min(self._seen_overlaps)
        self._overlap += (1.0 if lasting > self._overlap else OVERLAP_GAIN) * (lasting - self._overlap)
        self._seen_overlaps = self._seen_overlaps[1], 0.0
        if self._current is not None and self._overlap > LEAST_MARGIN:
            self._is_open = True
            self._current.given_up = now + self._overlap + LEAST_MARGIN
        elif self._current is not None:
            self._finish()

    def _add_older(self, head: SimpleNamespace, parts: Tuple[Any, ...], now: float, order: int) -> None:
        """Segments of an older frame came: they count where it is the one before the last one."""
        before, last = self._before, self._last
        if before is None or last is None or before.order != order or before.head != head:
            self.dropped['late'] += len(parts[0])
            return
        lag = now - last.began
        if not before.content.complete and lag <= MAX_OVERLAP:
            self._seen_overlaps = self._seen_overlaps[0], max(self._seen_overlaps[1], lag)
        if not self._is_open:
            self.dropped['late'] += len(parts[0])
        elif self._fit(before.content, parts).any():
            before.latest = self._accepted = now
            if before.content.complete:
                self._close()

    def _fit(self, content: Partial, parts: Tuple[Any, ...]) -> BoolArray:
        """Add m segments to a frame; (m,) which of them fit."""
        good = content.add(*parts)
        self.dropped['contradiction'] += len(good) - int(np.count_nonzero(good))
        return good

    def _expect(self, current: Frame[Partial], parts: Tuple[Any, ...], good: BoolArray, now: float) -> None:
        """Note when the frame in progress ends, now that some of these segments were added to it."""
        current.latest = self._accepted = now
        self._end.add(current.content.places(parts[0])[good], now)
        if current.content.complete:
            self._finish()
        else:
            current.given_up = self._end.given_up(current.content.awaited)

    def _learn(self, parts: Tuple[Any, ...], now: float) -> None:
        """Note when segments of the last finished frame came, unless they could not have been waited for."""
        assert self._last is not None
        if now < self._last.began + self.max_wait:
            places = self._last.content.places(parts[0])
            if (places >= 0).any():
                self._end.add(places[places >= 0], now)

    def _close(self) -> None:
        """The frame before the last one waits no longer."""
        assert self._before is not None
        self._is_open = False
        self._hand_over(self._before)

    def _finish(self) -> None:
        assert self._current is not None
        if self._is_open:
            self._close()
        self._surplus = 'not needed' if self._current.content.complete else 'late'
        self._hand_over(self._current)
        self._current = None

    def _hand_over(self, frame: Frame[Partial]) -> None:
        self._finished.append(frame)
        while len(self._finished) > self.max_finished:
            self._finished.popleft()
            self.dropped['overtaken frame'] += 1


class FrameAssemblers(Generic[Partial]):
    """A FrameAssembler for each of the sources of one stream.

    There are at most MAX_SOURCES. A new one takes the place of one that is idle, or none: forged segments must not end
    a true frame.

    :param begin, max_wait, began: as of FrameAssembler
    """

    def __init__(self, begin: Callable[[SimpleNamespace], Partial], max_wait: float,
                 began: Callable[[SimpleNamespace], None] = lambda head: None) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """As of FrameAssembler, of all together."""
        self._max_wait, self._max_finished = max_wait, MAX_FINISHED
        self._begin, self._began = begin, began
        self._sources: Dict[str, FrameAssembler[Partial]] = {}

    def _source(self, name: str, now: float) -> Optional[FrameAssembler[Partial]]:
        """That of a source; None: there are too many."""
        if name not in self._sources:
            if len(self._sources) == MAX_SOURCES:
                idle = min(self._sources, key=lambda other: self._sources[other].busy_until)
                if self._sources[idle].busy_until > now:
                    return None
                del self._sources[idle]
            made = self._sources[name] = FrameAssembler(self._begin, self._max_wait, self._began, self.dropped)
            made.max_finished = self._max_finished
        return self._sources[name]

    def configure(self, max_wait: Optional[float] = None, max_finished: Optional[int] = None) -> None:
        """Change what is not None, as of FrameAssembler."""
        self._max_wait = self._max_wait if max_wait is None else max_wait
        self._max_finished = self._max_finished if max_finished is None else max_finished
        for source in self._sources.values():
            source.max_wait, source.max_finished = self._max_wait, self._max_finished

    def deadline(self) -> Optional[float]:
        """As of FrameAssembler."""
        deadlines = [source.deadline() for source in self._sources.values()]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def poll(self, now: float) -> Optional[Frame[Partial]]:
        """As of FrameAssembler; of several sources that which is due first."""
        due = [(deadline, source) for source in self._sources.values()
               for deadline in [source.deadline()] if deadline is not None]
        return min(due, key=lambda one: one[0])[1].poll(now) if due else None

    def add(self, head: SimpleNamespace, parts: Tuple[Any, ...], now: float, order: Optional[int] = None) -> None:
        """As of FrameAssembler.

        :param head: `frame_id` names the source
        """
        source = self._source(frame_name(head.frame_id), now)
        if source is None:
            self.dropped['too many sources'] += len(parts[0])
        else:
            source.add(head, parts, now, order)
