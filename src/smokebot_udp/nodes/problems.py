# SPDX-License-Identifier: BSD-3-Clause
"""What a node was told wrongly, by its files and its parameters: on the console, and in diagnostics for a while."""
import collections
import threading
import time

import rospy

from ..monitoring.windows import OK, WARN

REMEMBERED = 5
"""Problems."""

RECENT = 60.0
"""So long a problem makes diagnostics WARN [s]."""


class Problems:
    """The problems of one node; any thread may tell."""

    def __init__(self):
        self.count = 0
        self._last = collections.deque(maxlen=REMEMBERED)     # (when [s], problem)
        self._lock = threading.Lock()

    def tell(self, problem):
        rospy.logerr('%s', problem)
        with self._lock:
            self.count += 1
            self._last.append((time.monotonic(), problem))

    def verdict(self, now):
        """(level, message, {name: value}) for diagnostics.

        :param now: time.monotonic() [s]
        """
        with self._lock:
            recent = [problem for when, problem in self._last if now - when < RECENT]
            values = {'problems': self.count}
            values.update(('problem %d' % (self.count - back), '%s (%.0f s ago)' % (problem, now - when))
                          for back, (when, problem) in enumerate(reversed(self._last)))
        return (WARN, recent[-1], values) if recent else (OK, 'fine', values)
