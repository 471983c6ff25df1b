# SPDX-License-Identifier: BSD-3-Clause
"""The machine on which a measurement is made."""
import os
import platform
import re


def describe() -> str:
    """One line: processor, cores, kernel, Python."""
    with open('/proc/cpuinfo') as file:
        model = re.search(r'model name\s*:\s*(.*)', file.read())
    return '%s, %s cores, Linux %s, Python %s' % (
        model.group(1) if model else platform.machine(), os.cpu_count(), platform.release(), platform.python_version())
