# SPDX-License-Identifier: BSD-3-Clause
import pathlib
import subprocess
import sys

SRC = pathlib.Path(__file__).resolve().parents[2] / 'src'

PROGRAM = """
import gc
import time
import weakref
from smokebot_udp.nodes.garbage import MANY, collect_regularly

def wait_for_searches():
    # The third one begins after the second, which began later than this call, has decided.
    searches = gc.get_stats()[2]['collections']
    while gc.get_stats()[2]['collections'] < searches + 3 and time.monotonic() < deadline:
        time.sleep(0.01)

class Connection:
    def __init__(self):
        self.itself = self

first = Connection()
collect_regularly(0.05)
connection = Connection()
gc.collect()            # it lives for a while
ended, deadline = weakref.ref(connection), time.monotonic() + 60
del connection
while ended() is not None and time.monotonic() < deadline:
    time.sleep(0.01)
print(ended() is None, any(one is first for one in gc.get_objects()))
loaded = [[number] for number in range(10 ** 6)]
wait_for_searches()     # whatever of them is still looked at is few then
connection = Connection()
wait_for_searches()
print(len(gc.get_objects()) > MANY, any(one is connection for one in gc.get_objects()))
"""
"""A node with few objects, one of which ends, and then many that stay. It prints whether that one is freed, and whether
one from the start, many, and a new one are still looked at after some searches."""


def test_what_has_ended_is_freed_soon_and_what_is_old_is_not_looked_at() -> None:
    assert subprocess.check_output([sys.executable, '-c', PROGRAM]).split() == [b'True', b'False', b'False', b'True']


def test_nobody_refers_to_all_objects() -> None:
    """Beside gc.get_objects() tuple(generator) raises SystemError in other threads, once in some thousand times."""
    calls = [path for path in SRC.rglob('*.py') for name in ('get_objects(', 'get_referrers(')
             if 'gc.' + name in path.read_text().replace('gc.get_objects() would', '')]
    assert calls == []
