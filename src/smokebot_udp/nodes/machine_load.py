# SPDX-License-Identifier: BSD-3-Clause
"""How loaded this machine is, so that a report can tell an overloaded machine from a link that was cut."""
import os

LOADED = '/proc/loadavg'
"""Its fourth field: programs that run or want to / all programs."""


def load(text: str, processors: int) -> float:
    """Programs that run or want to, for each processor, this one aside.

    :param text: of /proc/loadavg
    """
    return max(0, int(text.split()[3].split('/')[0]) - 1) / processors


def present_load() -> float:
    """The load of this machine now."""
    with open(LOADED, encoding='ascii') as file:
        return load(file.read(), os.cpu_count() or 1)
