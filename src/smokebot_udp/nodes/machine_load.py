# SPDX-License-Identifier: BSD-3-Clause
"""Tells how loaded this machine is, so that a report can tell an overloaded machine from a link that was cut."""
import os
import threading
from typing import Callable

LOADED = '/proc/loadavg'
"""Its fourth field: programs that run or want to / all programs."""


def load(text: str, processors: int) -> float:
    """Programs that run or want to, for each processor, this one aside.

    :param text: of /proc/loadavg
    """
    return max(0, int(text.split()[3].split('/')[0]) - 1) / processors


class MachineLoad:
    """Tells it from a thread.

    :param tell: f(load)
    :param period: [s]
    """

    def __init__(self, tell: Callable[[float], None], period: float) -> None:
        self._tell, self._period, self._ended = tell, period, threading.Event()
        self._thread = threading.Thread(target=self._run, name='load', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.wait(self._period):
            with open(LOADED, encoding='ascii') as file:
                self._tell(load(file.read(), os.cpu_count() or 1))
