# SPDX-License-Identifier: BSD-3-Clause
"""Sources of another type than a stream expects: ROS does not connect them, so they look silent."""
from typing import Callable, Mapping, Optional

PERIOD, MAX_PERIOD = 5.0, 60.0
"""The master is asked at most this often; while it knows no problem, less and less often: its answer has kilobytes, and
crosses the link where both sides share a master [s]."""


class SourceTypes:
    """The types of topics as the master knows them.

    :param ask: f(), called when they are wanted: `types` is to be set then, in another thread where that takes its time
    """

    def __init__(self, ask: Callable[[], None]) -> None:
        self._ask = ask
        self.types: Mapping[str, str] = {}
        """{topic: type}; empty while the master does not answer."""
        self._due, self._period = -float('inf'), PERIOD

    def problem(self, topic: str, expected: str, now: float) -> Optional[str]:
        """The problem of a topic of another type than expected; None: it has this type, or is unknown.

        :param expected: package/Type, or several with ' or ' between them
        :param now: by a steady clock [s]
        """
        if now >= self._due:
            self._due, self._period = now + self._period, min(2 * self._period, MAX_PERIOD)
            self._ask()
        found = self.types.get(topic, '*')
        if found in (*expected.split(' or '), '*'):
            return None
        self._due, self._period = min(self._due, now + PERIOD), PERIOD
        return '%s is published as %s, must be %s' % (topic, found, expected)
