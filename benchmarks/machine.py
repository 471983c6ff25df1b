# SPDX-License-Identifier: BSD-3-Clause
"""On what the numbers were measured."""
import os
import platform
import re


def describe():
    """One line: processor, cores, kernel, Python."""
    with open('/proc/cpuinfo') as file:
        model = re.search(r'model name\s*:\s*(.*)', file.read())
    return '%s, %d cores, Linux %s, Python %s' % (
        model.group(1) if model else platform.machine(), os.cpu_count(), platform.release(), platform.python_version())
