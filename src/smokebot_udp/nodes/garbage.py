# SPDX-License-Identifier: BSD-3-Clause
"""Garbage collection: what an ended connection leaves is freed within seconds.

Connections, their threads and rospy's objects refer to each other. Python looks for such garbage among all objects when
enough new ones have come, which takes hours in a node that mostly handles arrays: one whose peers restart again and
again would grow. So it looks regularly, but not among what was made at the start: that takes 1 ms instead of 30, in
which no thread of the node runs and commands wait. Nor does it look a second time among the many objects that are
loaded later, such as a codec. What is alive then is never looked at again, so that must be rare: their number decides,
and not how long a busy machine takes. Then free memory returns to the kernel.
"""
import gc

from .logging import log_error
from .malloc_tuning import return_freed_memory
from .worker import PeriodicWorker

PERIOD = 10.0
"""Time from one search to the next [s]."""

MANY = 50000
"""Where more objects than these are found in use, they are not looked at again: a search takes some ms then."""


def collect_regularly(period: float = PERIOD) -> None:
    """Collect garbage regularly, of what is made from now on, until the process ends."""
    gc.collect()
    gc.freeze()
    PeriodicWorker('garbage', _collect, log_error('garbage collection'), period).start()


def _collect() -> None:
    gc.collect()
    if len(gc.get_objects()) > MANY:
        gc.freeze()
    return_freed_memory()
