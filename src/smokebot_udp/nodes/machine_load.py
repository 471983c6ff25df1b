# SPDX-License-Identifier: BSD-3-Clause
"""How loaded this machine is, see monitoring/computer.py."""
import os

from ..monitoring.computer import load


def present_load() -> float:
    """The load of this machine now."""
    with open('/proc/loadavg', encoding='ascii') as file:
        return load(file.read(), os.cpu_count() or 1)
