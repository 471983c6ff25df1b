# SPDX-License-Identifier: BSD-3-Clause
"""Garbage collection: what an ended connection leaves is freed within seconds.

Connections, their threads and rospy's objects refer to each other. Python looks for such garbage among all objects when
enough new ones have come, which takes hours in a node that mostly handles arrays: one whose peers restart again and
again would grow. So it looks regularly, but not among what was made at the start: that takes 1 ms instead of 30, in
which no thread of the node runs and commands wait. Nor does it look a second time among the many objects that are
loaded later, such as a codec. What is alive then is never looked at again, so that must be rare: their number decides,
and not how long a busy machine takes. Then free memory returns to the kernel.

gc.get_objects() would count them, but must not be called beside other threads: it also refers to tuples that
`tuple(generator)` is making there, which then raises SystemError.
"""
import gc
import sys

from .logging import log_error
from .malloc_tuning import return_freed_memory
from .worker import PeriodicWorker

PERIOD = 10.0
"""Time from one search to the next [s]."""

MANY = 150000
"""Where more blocks of memory than these have been added, their objects are not looked at again: a search takes some ms
then. An object that the collector looks at takes 2.7 to 3.5 blocks."""


def collect_regularly(period: float = PERIOD) -> None:
    """Collect garbage regularly, of what is made from now on, until the process ends."""
    gc.collect()
    PeriodicWorker('garbage', Searches().search, log_error('garbage collection'), period).start()


class Searches:
    """Searches what was made since the last time that many objects were found in use, or since it was made itself."""

    def __init__(self) -> None:
        self._freeze()

    def _freeze(self) -> None:
        gc.freeze()
        self._frozen = sys.getallocatedblocks()

    def search(self) -> None:
        """Free garbage, and return free memory to the kernel."""
        gc.collect()
        if sys.getallocatedblocks() - self._frozen > MANY:
            self._freeze()
        return_freed_memory()
