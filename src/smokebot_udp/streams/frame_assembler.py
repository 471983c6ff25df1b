# SPDX-License-Identifier: BSD-3-Clause
"""Which frame is finished when: a jitter buffer of one frame in progress, without clock or ROS (D6.3, section 4.2).

A frame is the segments of one message: they have the same stamp. It is finished when all that was sent of it has been
received, QUIET after one of its last segments, when a segment of a newer frame is received, or max_wait after its
first segment. Segments of a finished frame are late, or not needed if it was complete, and change nothing.

A frame is finished once: what is received later does not bring out a better version of it. Two messages of one stamp
would look like two images to whoever counts or records them, and the better version is at most QUIET, or the time to
the next frame, away.
"""
import collections
import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Callable, Counter, Deque, Generic, Optional, Protocol, Tuple, TypeVar

import numpy as np

from ..arrays import BoolArray

RESTART = 2.0
"""A stamp that is older than the newest one by more is not late: the source's clock was set back, or a recording
starts again [s]."""

MAX_REORDERING = 0.3
"""Nor is any older stamp where no other segment was accepted for this long: no link reorders by so much. The clock was
set back by less, or a short recording starts again [s]."""

QUIET = 0.02
"""How long a frame waits for reordered segments after one of its last ones [s]."""

MAX_WAIT = 0.2
"""How long images, clouds and the like are waited for, unless an operator changes max_wait. Encoders that spread a
message over time know by it how long it may take [s]."""

MAX_FINISHED = 2
"""Finished frames that wait to be taken, unless a kind says otherwise; newer ones replace the oldest."""


class PartialFrame(Protocol):
    """What was received of a frame."""

    @property
    def ending(self) -> bool:
        """Whether one of the last segments was received."""

    @property
    def complete(self) -> bool:
        """Whether all that was sent of it was received, or can be restored."""

    @property
    def completeness(self) -> float:
        """Received share, 0..1."""

    def add(self, *parts: Any) -> BoolArray:
        """Add m segments; (m,) which of them fit. The others are dropped."""


Partial = TypeVar('Partial', bound=PartialFrame)


@dataclass
class Frame(Generic[Partial]):
    """A frame, in progress or finished."""
    head: SimpleNamespace
    """The fields that all of its segments repeat, see segments.head_of; `head.stamp` identifies the frame [ns]."""
    content: Partial
    began: float
    """When its first segment was received [s]."""
    latest: float
    """When the last one so far was received [s]."""


class FrameAssembler(Generic[Partial]):
    """Sorts segments into frames; one is in progress at a time.

    :param begin: f(head) -> PartialFrame, empty; raises ValueError if the head is impossible
    :param max_wait: may be changed at any time [s]
    """

    def __init__(self, begin: Callable[[SimpleNamespace], Partial], max_wait: float) -> None:
        self.max_wait = max_wait
        self.max_finished = MAX_FINISHED
        """May be changed at any time."""
        self.dropped: Counter[str] = collections.Counter()
        """Segments that changed nothing, by reason: late, not needed, contradiction, impossible head."""
        self._begin = begin
        self._newest: Optional[int] = None      # stamp of the frame in progress, or of the last one finished
        self._surplus = 'late'                  # what further segments of the last finished frame are
        self._accepted = -math.inf              # when a segment was accepted last
        self._current: Optional[Frame[Partial]] = None
        self._finished: Deque[Frame[Partial]] = collections.deque()

    def deadline(self) -> Optional[float]:
        """When `poll` returns a frame next, unless more is added; None: never [s]."""
        if self._finished:
            return -math.inf
        current = self._current
        if current is None:
            return None
        latest = current.began + self.max_wait
        return min(latest, current.latest + QUIET) if current.content.ending else latest

    def poll(self, now: float) -> Optional[Frame[Partial]]:
        """The oldest finished frame that was not returned before; None if there is none."""
        deadline = self.deadline()
        if deadline is None or now < deadline:
            return None
        if not self._finished:
            self._finish()
        return self._finished.popleft()

    def add(self, head: SimpleNamespace, parts: Tuple[Any, ...], now: float) -> None:
        """Take m segments of one frame.

        :param head: the fields that they repeat
        :param parts: arguments of PartialFrame.add; the first has length m
        :param now: by any steady clock [s]
        """
        count, stamp = len(parts[0]), head.stamp
        older = self._newest is not None and 0 < self._newest - stamp < RESTART * 1e9
        if older and now - self._accepted <= MAX_REORDERING:
            self.dropped['late'] += count
        elif stamp != self._newest:
            self._add_new(head, parts, now)
        elif self._current is None:
            self.dropped[self._surplus] += count
        elif self._current.head != head:
            self.dropped['contradiction'] += count
        elif self._fit(self._current.content, parts):
            self._current.latest = self._accepted = now
        if self._current is not None and self._current.content.complete:
            self._finish()

    def _add_new(self, head: SimpleNamespace, parts: Tuple[Any, ...], now: float) -> None:
        try:
            content = self._begin(head)
        except ValueError:
            self.dropped['impossible head'] += len(parts[0])
            return
        # only segments that fit start a frame: forged ones must not finish the one in progress
        if self._fit(content, parts):
            if self._current is not None:
                self._finish()
            self._newest, self._current, self._accepted = head.stamp, Frame(head, content, now, now), now

    def _fit(self, content: Partial, parts: Tuple[Any, ...]) -> bool:
        """Add segments to a frame; whether any of them fits."""
        good = content.add(*parts)
        self.dropped['contradiction'] += len(good) - int(np.count_nonzero(good))
        return bool(good.any())

    def _finish(self) -> None:
        assert self._current is not None
        self._surplus = 'not needed' if self._current.content.complete else 'late'
        self._finished.append(self._current)
        while len(self._finished) > self.max_finished:
            self._finished.popleft()
        self._current = None
