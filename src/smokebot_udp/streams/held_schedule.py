# SPDX-License-Identifier: BSD-3-Clause
"""When an operator reports what it holds: soon after segments arrived, and regularly while the robot sends."""
import math
from typing import Dict, Optional

COALESCED = 0.1
"""Reports of a stream are this far apart at least, unless its kind says otherwise [s]."""

PERIOD = 1.5
"""Reports get lost: without new segments they are repeated [s]."""

MAX_SILENCE = 10.0
"""A robot that is silent for longer is not reported to: beats come once a second, and most of them may be lost [s]."""


class _Stream:
    def __init__(self) -> None:
        self.received = -math.inf   # when segments were received last [s]
        self.reported = -math.inf
        self.news = False           # whether any were received since the last report
        self.interval = COALESCED   # between reports, at least [s]

    def deadline(self) -> float:
        if self.news:
            return self.reported + self.interval
        due = self.reported + PERIOD
        return due if due - self.received <= MAX_SILENCE else math.inf


class HeldSchedule:
    """Decides for several streams. All times are by one steady clock [s]."""

    def __init__(self) -> None:
        self._streams: Dict[str, _Stream] = {}

    def received(self, name: str, now: float, interval: float = COALESCED) -> None:
        """Note that segments of a stream were received, those that are held already included: the last report may be
        lost.

        :param interval: between reports of this stream, at least [s]
        """
        stream = self._streams.setdefault(name, _Stream())
        stream.received, stream.news, stream.interval = now, True, interval

    def deadline(self) -> Optional[float]:
        """When `poll` returns a stream next; None: not before segments are received."""
        due = min((stream.deadline() for stream in self._streams.values()), default=math.inf)
        return None if due == math.inf else due

    def poll(self, now: float) -> Optional[str]:
        """The name of a stream that is to be reported now."""
        for name, stream in self._streams.items():
            if stream.deadline() <= now:
                stream.reported, stream.news = now, False
                return name
        return None
