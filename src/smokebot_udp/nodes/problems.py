# SPDX-License-Identifier: BSD-3-Clause
"""Errors in a node's files and parameters: on the console, and in diagnostics for a while."""
import collections
import threading
import time
from typing import Any, Deque, Dict, Tuple

from ..limited_log import logerr
from ..monitoring.status import OK, WARN, Kind, Status

REMEMBERED = 5
"""Problems."""

RECENT = 60.0
"""Time for which a problem makes diagnostics WARN [s]."""

AGAIN = 1.0
"""Problems of one kind are logged this far apart: a person may try another value, a program many [s]."""


class Problems:
    """The problems of one node; any thread may report them."""

    def __init__(self) -> None:
        self.count = 0
        self._last: Deque[Tuple[float, str]] = collections.deque(maxlen=REMEMBERED)     # (when [s], problem)
        self._lock = threading.Lock()

    def report(self, problem: str) -> None:
        """Report a problem."""
        logerr('', problem, AGAIN)
        with self._lock:
            self.count += 1
            self._last.append((time.monotonic(), problem))

    def status(self, now: float) -> Status:
        """For diagnostics: which settings were refused.

        :param now: time.monotonic() [s]
        """
        with self._lock:
            recent = [problem for when, problem in self._last if now - when < RECENT]
            values: Dict[str, Any] = {'problems': self.count}
            values.update(('problem %d' % (self.count - back), '%s (%.0f s ago)' % (problem, now - when))
                          for back, (when, problem) in enumerate(reversed(self._last)))
        return Status(Kind.SETTINGS, 'settings', WARN if recent else OK, recent[-1] if recent else 'fine', values)
