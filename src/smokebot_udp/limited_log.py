# SPDX-License-Identifier: BSD-3-Clause
"""Errors and warnings of what may happen many times a second: each kind of problem of each subject now and then.

Two problems are of one kind if their texts differ in numbers only: what is wrong with each message of a stream is one
problem, whatever the values are. A line says how many of its kind were left out before it.
"""
import re
import threading
import time
from typing import Any, Callable, NamedTuple, Optional, Tuple

import rospy

from .budget import Budget
from .newest import Newest

ERROR_PERIOD, WARNING_PERIOD = 5.0, 60.0
"""A kind of problem of a subject is logged once in this time, unless a caller says otherwise [s]."""

BURST, PERIOD = 60, 2.0
"""Number of lines that may be logged at once, over all problems, and interval of further lines: the subjects may
contain names of strangers [s]."""

MAX_REMEMBERED = 512
"""Maximum number of kinds of problems that are remembered. The one that came up longest ago is forgotten first."""

ENDED = 'to a closed topic', "'NoneType' object has no attribute 'get_num_connections'"
"""Parts of what rospy raises in a thread that uses topics while the node's other threads end: rospy.is_shutdown() is
True only after all of on_shutdown."""

NUMBER = re.compile(r'\S*\d\S*')
"""A word with a digit: a value, a time, some bytes."""


class _Logged(NamedTuple):
    when: float
    """[s]"""
    left_out: int
    """Since then."""


class LogLimiter:
    """Decides what is logged; any thread may ask."""

    def __init__(self) -> None:
        self._logged: Newest[Tuple[str, str], _Logged] = Newest(MAX_REMEMBERED)
        self._budget = Budget(BURST, PERIOD)
        self._lock = threading.Lock()

    def admit(self, subject: str, problem: str, period: float, now: float) -> Optional[int]:
        """Whether to log a problem now.

        :param subject: what has the problem, such as a stream
        :param period: the same kind is logged only after this time [s]
        :param now: by a steady clock [s]
        :return: how many of its kind were left out since the last one; None: it is left out
        """
        key = subject, kind_of(problem)
        with self._lock:
            before = self._logged.get(key)
            if before is not None and now - before.when < period or not self._budget.take(now):
                if before is not None:
                    self._logged[key] = before._replace(left_out=before.left_out + 1)
                return None
            self._logged[key] = _Logged(now, 0)
            return before.left_out if before is not None else 0


def kind_of(problem: str) -> str:
    """The text of a problem without its numbers."""
    return NUMBER.sub('#', problem)


_limiter = LogLimiter()


def forget() -> None:
    """Begin anew, as after a start of the node."""
    global _limiter
    _limiter = LogLimiter()


def logerr(subject: str, problem: Any, period: float = ERROR_PERIOD) -> bool:
    """Log an error, `subject: problem`, unless the node shuts down or it is left out.

    :param subject: what has the problem; empty: the text says it
    :param problem: an exception or a text
    :param period: see LogLimiter.admit [s]
    :return: whether it is logged
    """
    return _log(rospy.logerr, subject, str(problem), period)


def logwarn(subject: str, problem: Any, period: float = WARNING_PERIOD) -> bool:
    """Likewise, a warning."""
    return _log(rospy.logwarn, subject, str(problem), period)


def _log(log: Callable[..., None], subject: str, problem: str, period: float) -> bool:
    if rospy.core.is_shutdown_requested() and any(part in problem for part in ENDED):
        return False
    left_out = None if rospy.is_shutdown() else _limiter.admit(subject, problem, period, time.monotonic())
    if left_out is None:
        return False
    text = ': '.join(filter(None, (subject, problem)))
    log('%s%s', text, ' (and %d more like it)' % left_out if left_out else '')
    return True
