# SPDX-License-Identifier: BSD-3-Clause
"""Throttled logging of errors in threads that continue."""
import time
from typing import Callable, Tuple

import rospy


def log_error(subject: str, period: float = 60.0) -> Callable[[Exception], None]:
    """A function that logs errors of one subject until the node shuts down.

    :param subject: what fails; the log message begins with it
    :param period: the same message is repeated only after this time [s]
    """
    last: Tuple[str, float] = '', 0.0

    def log(error: Exception) -> None:
        nonlocal last
        message, now = '%s: %s' % (subject, error), time.monotonic()
        if rospy.is_shutdown() or (message == last[0] and now - last[1] < period):
            return
        last = message, now
        rospy.logerr('%s', message)
    return log
