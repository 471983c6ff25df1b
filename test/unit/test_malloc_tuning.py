# SPDX-License-Identifier: BSD-3-Clause
import subprocess
import sys

PROGRAM = """
import threading
import numpy as np
import psutil
from smokebot_udp.nodes.malloc_tuning import keep_freed_memory

SIZE, THREADS = 8 << 20, 8

keep_freed_memory()
process, barrier, one = psutil.Process(), threading.Barrier(THREADS), threading.Lock()
kept = []

def work():
    np.zeros(1000)
    barrier.wait()          # all threads live at the same time, each in an arena of its own
    with one:
        array = np.ones(SIZE, np.uint8)
        kept.append(np.zeros(100))
        del array
    barrier.wait()

threads = [threading.Thread(target=work) for _ in range(THREADS)]
before = process.memory_info().rss
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print((process.memory_info().rss - before) / SIZE)
"""
"""A program in which threads take and free the same amount of memory in turn; it prints how often that is resident."""


def test_what_a_thread_has_freed_serves_the_next_one() -> None:
    assert 0.9 < float(subprocess.check_output([sys.executable, '-c', PROGRAM])) < 2


GAPS = """
import numpy as np
import psutil
from smokebot_udp.nodes.malloc_tuning import keep_freed_memory, return_freed_memory

SIZE, COUNT = 1 << 16, 512

keep_freed_memory()
process = psutil.Process()
before = process.memory_info().rss
arrays = [np.ones(SIZE, np.uint8) for _ in range(COUNT)]
kept = arrays[::16]
del arrays
print((process.memory_info().rss - before) / (SIZE * COUNT))
return_freed_memory()
print((process.memory_info().rss - before) / (SIZE * COUNT))
"""
"""A program that keeps every 16th of its arrays; it prints which part of all is resident, and what is left of it."""


def test_the_gaps_that_a_peak_leaves_return_to_the_kernel() -> None:
    kept, left = map(float, subprocess.check_output([sys.executable, '-c', GAPS]).split())
    assert kept > 0.9 and left < 0.3
