# SPDX-License-Identifier: BSD-3-Clause
"""Logging of errors in threads that continue."""
from typing import Any, Callable

from ..limited_log import WARNING_PERIOD, logerr


def log_error(subject: str, period: float = WARNING_PERIOD) -> Callable[[Any], None]:
    """A function that logs errors of one subject, exceptions or texts, until the node shuts down.

    :param subject: what fails; the log message begins with it
    :param period: errors of the same kind are logged only after this time [s]
    """
    def log(error: Any) -> None:
        logerr(subject, error, period)
    return log
