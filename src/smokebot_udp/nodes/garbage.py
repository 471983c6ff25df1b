# SPDX-License-Identifier: BSD-3-Clause
"""Garbage collection: what an ended connection leaves is freed within seconds.

Connections, their threads and rospy's objects refer to each other. Python looks for such garbage among all objects when
enough new ones have come, which takes hours in a node that mostly handles arrays: one whose peers restart again and
again would grow. So it looks regularly, but not among what was made at the start: that takes 1 ms instead of 30, in
which no thread of the node runs and commands wait. Nor does it look a second time among the many objects that are
loaded later, such as a codec. Then free memory returns to the kernel.
"""
import gc
import time

from .logging import log_error
from .malloc_tuning import return_freed_memory
from .worker import PeriodicWorker

PERIOD = 10.0
"""Time from one search to the next [s]."""

MAX_SEARCH = 0.005
"""What is found in use by a search that takes longer is not looked at again [s of the processor]."""


def collect_regularly(period: float = PERIOD) -> None:
    """Collect garbage regularly, of what is made from now on, until the process ends."""
    gc.collect()
    gc.freeze()
    PeriodicWorker('garbage', _collect, log_error('garbage collection'), period).start()


def _collect() -> None:
    begun = time.thread_time()
    gc.collect()
    if time.thread_time() - begun > MAX_SEARCH:
        gc.freeze()
    return_freed_memory()
