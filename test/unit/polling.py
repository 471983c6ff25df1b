# SPDX-License-Identifier: BSD-3-Clause
"""How unit tests wait for other threads and processes."""
import time
from typing import Any, Callable

WAIT = 60.0     # longer than anything takes that is waited for, on a slow machine that stalls as well [s]


def wait_for(condition: Callable[[], Any], seconds: float = WAIT) -> Any:
    """The first true value of condition(); AssertionError after `seconds`."""
    until = time.monotonic() + seconds
    while True:
        value = condition()
        if value:
            return value
        assert time.monotonic() < until, 'it did not come in %g s' % seconds
        time.sleep(0.002)


def give_time(seconds: float = 0.05) -> None:
    """Wait for as long as something would take that must not happen: nothing announces that it does not."""
    time.sleep(seconds)
