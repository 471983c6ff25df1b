# SPDX-License-Identifier: BSD-3-Clause
"""How much memory nodes keep. Between two returns of freed memory to the kernel (smokebot_udp/nodes/garbage.py), their
resident memory rises by up to 35 MB and falls again, with nobody attacking them: one sample says nothing."""
import bisect
import contextlib
import threading
import time
from typing import Dict, List, Mapping, Sequence

import psutil

from smokebot_udp.nodes.garbage import PERIOD

KEPT = PERIOD + 2.0
"""Only what stays for this long counts: freed memory is returned meanwhile [s]."""

SAMPLING = 0.2
"""[s]"""


def most_kept(times: Sequence[float], sizes: Sequence[float], seconds: float = KEPT) -> float:
    """The most that was there for a whole time of `seconds`; where there are fewer samples, what was there in all.

    :param times: of the samples, ascending; not empty [s]
    :param sizes: of memory
    """
    found = [min(sizes)]
    for start, begun in enumerate(times):
        if begun + seconds <= times[-1]:
            end = bisect.bisect_right(times, begun + seconds)
            found.append(min(sizes[start:end]))
    return max(found)


class KeptMemory:
    """Samples the resident memory of nodes, from when it is made until one of them ends.

    :param processes: {node: process id}
    """

    def __init__(self, processes: Mapping[str, int]) -> None:
        self._processes = {name: psutil.Process(process) for name, process in processes.items()}
        self._times: List[float] = []
        self._sizes: Dict[str, List[float]] = {name: [] for name in processes}
        threading.Thread(target=self._sample, daemon=True).start()

    def _sample(self) -> None:
        with contextlib.suppress(psutil.NoSuchProcess):
            while True:
                for name, process in self._processes.items():
                    self._sizes[name].append(float(process.memory_info().rss))
                self._times.append(time.monotonic())    # last: others read
                time.sleep(SAMPLING)

    def since(self, begun: float) -> Dict[str, float]:
        """{node: most_kept of the samples since a time.monotonic()} [byte]"""
        count = len(self._times)
        first = next(at for at in range(count) if self._times[at] >= begun)
        return {name: most_kept(self._times[first:count], sizes[first:count]) for name, sizes in self._sizes.items()}
