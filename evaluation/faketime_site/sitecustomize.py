# SPDX-License-Identifier: BSD-3-Clause
"""Python runs this at its start where it is on PYTHONPATH: time.sleep works under libfaketime 0.9.10.

There clock_nanosleep fails with EINVAL if CLOCK_MONOTONIC is not faked (libfaketime's issue 426), and Python's
time.sleep uses it since 3.11.
"""
import select
import time


def sleep(seconds: float) -> None:
    """As time.sleep."""
    select.select((), (), (), seconds)


time.sleep = sleep
