# SPDX-License-Identifier: BSD-3-Clause
"""How much memory nodes keep.

Between two returns of freed memory to the kernel (smokebot_udp/nodes/garbage.py), their resident memory rises by up to
35 MB and falls again, with nobody attacking them: one sample says nothing. The least of 25 s still varied by 20 MB in
400 s without an attack, and once by 30 MB, on both sides at the same time; it had no trend after the first 40 s, in
which nodes grow by 15 MB. So what is kept is to be compared with the most that was kept before, not with the last time.
"""
import bisect
import contextlib
import threading
import time
from typing import Dict, List, Mapping, Sequence

import psutil

from smokebot_udp.nodes.garbage import PERIOD

QUICK_KEPT, KEPT = PERIOD + 2.0, 2.5 * PERIOD
"""Only what stays for this long counts: freed memory is returned meanwhile, in the latter twice [s]."""

STEADY, TIMEOUT = 5e6, 150.0
"""Nodes have started when they keep no more than this beyond what they kept before, but after this time in any case
[byte, s]."""

SAMPLING = 0.2
"""[s]"""


def most_kept(times: Sequence[float], sizes: Sequence[float], seconds: float) -> float:
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
    :param kept: see KEPT [s]
    """

    def __init__(self, processes: Mapping[str, int], kept: float = KEPT) -> None:
        self.kept = kept
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
        return {name: most_kept(self._times[first:count], sizes[first:count], self.kept)
                for name, sizes in self._sizes.items()}

    def await_steady(self) -> None:
        """Wait until the nodes keep hardly more than before."""
        deadline, before = time.monotonic() + TIMEOUT, dict.fromkeys(self._sizes, 0.0)
        while time.monotonic() < deadline:
            begun = time.monotonic()
            time.sleep(self.kept)
            now = self.since(begun)
            if all(now[name] - before[name] < STEADY for name in now):
                return
            before = now
