# SPDX-License-Identifier: BSD-3-Clause
"""Child processes of benchmarks and tests end with their parent."""
import subprocess
import sys

import psutil
import pytest
from polling import WAIT

from evaluation import TOP, processes

HASTY = """
import os
from evaluation import processes
print(processes.start(['sleep', '600']).pid, flush=True)
os.kill(os.getpid(), 9)
"""
"""It is killed before its child asks for a signal at its end, mostly."""


@pytest.mark.parametrize('_', range(5))
def test_a_child_does_not_outlive_a_parent_that_is_killed_at_once(_) -> None:
    parent = subprocess.run([sys.executable, '-c', HASTY], cwd=str(TOP), stdout=subprocess.PIPE)
    try:
        child = psutil.Process(int(parent.stdout))
    except psutil.NoSuchProcess:
        return
    assert not psutil.wait_procs([child], timeout=WAIT)[1]


def test_a_child_of_a_living_parent_runs() -> None:
    process = processes.start(['sh', '-c', 'echo "$1"', '-', 'two words'], stdout=subprocess.PIPE)
    assert process.communicate()[0] == b'two words\n' and process.returncode == 0
