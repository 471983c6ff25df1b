# SPDX-License-Identifier: BSD-3-Clause
"""Sources of another type than a stream expects: ROS does not connect them, so they look silent."""
from typing import Callable, Dict, Optional, Sequence, Tuple

PERIOD = 5.0
"""The master is asked at most this often [s]."""


class SourceTypes:
    """The types of topics as the master knows them.

    :param ask: f() -> [(topic, type), ...]; None: the answer has not come yet; may raise OSError
    """

    def __init__(self, ask: Callable[[], Optional[Sequence[Tuple[str, str]]]]) -> None:
        self._ask = ask
        self._types: Dict[str, str] = {}
        self._due = -float('inf')

    def problem(self, topic: str, expected: str, now: float) -> Optional[str]:
        """The problem of a topic of another type than expected; None: it has this type, or is unknown.

        :param expected: package/Type, or several with ' or ' between them
        :param now: by a steady clock [s]
        """
        if now >= self._due:
            try:
                answer = self._ask()
            except OSError:
                answer = ()
            if answer is not None:
                self._types, self._due = dict(answer), now + PERIOD
        found = self._types.get(topic, '*')
        if found in (*expected.split(' or '), '*'):
            return None
        return '%s is published as %s, must be %s' % (topic, found, expected)
