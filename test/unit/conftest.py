# SPDX-License-Identifier: BSD-3-Clause
"""How hypothesis runs here: a machine that is busy with something else makes no property false. Continuous integration
tries the same examples each time: what fails there fails elsewhere, too. Others search on.

Compiled loops check their indexes here. They have a cache of their own: numba would take unchecked ones from another.
"""
import os
import pathlib
import sys

import pytest
from hypothesis import HealthCheck, settings

from smokebot_udp import limited_log

TOP = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(TOP))    # benchmarks, evaluation and experiments; pytest's option pythonpath is new in 7.0

settings.register_profile('busy machine', deadline=None, suppress_health_check=[HealthCheck.too_slow],
                          derandomize='CI' in os.environ)
settings.load_profile('busy machine')

os.environ['NUMBA_BOUNDSCHECK'] = '1'
os.environ['NUMBA_NRT_STATS'] = '1'     # counts of allocations, which numba 0.58 and later keep only if told
os.environ['NUMBA_CACHE_DIR'] = str(TOP / '.pytest_cache' / 'checked_loops')


@pytest.fixture(autouse=True)
def all_is_logged() -> None:
    """What a test before has logged says nothing of this one."""
    limited_log.forget()
