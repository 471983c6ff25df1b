# SPDX-License-Identifier: BSD-3-Clause
"""Waiting for what happens in other processes and says nothing of it."""
import time
from typing import Any, Callable, Optional


def wait_for(found: Callable[[], Any], timeout: float, period: float = 0.05) -> Optional[Any]:
    """The first true value of found(); None: none comes in time.

    :param timeout: [s]
    :param period: between two looks [s]
    """
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        value = found()
        if value:
            return value
        time.sleep(period)
    return None
