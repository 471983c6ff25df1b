# SPDX-License-Identifier: BSD-3-Clause
import subprocess
import sys

PROGRAM = """
import gc
import time
import weakref
from smokebot_udp.nodes.garbage import collect_regularly

class Connection:
    def __init__(self):
        self.itself = self

first = Connection()
collect_regularly(0.05)
connection = Connection()
gc.collect()            # it lives for a while
ended, deadline = weakref.ref(connection), time.monotonic() + 30
del connection
while ended() is not None and time.monotonic() < deadline:
    time.sleep(0.01)
print(ended() is None, any(one is first for one in gc.get_objects()))
loaded = [[number] for number in range(10 ** 6)]
while any(one is loaded for one in gc.get_objects()) and time.monotonic() < deadline:
    time.sleep(0.1)
looked_at = False
while not looked_at and time.monotonic() < deadline:
    connection = Connection()
    looked_at = any(one is connection for one in gc.get_objects())
print(any(one is loaded for one in gc.get_objects()), looked_at)
"""
"""A node with few objects, one of which ends, and then many that stay. It prints whether that one is freed, and whether
one from the start, one of the many, and new ones are looked at: one of them may come while a search takes long."""


def test_what_has_ended_is_freed_soon_and_what_is_old_is_not_looked_at() -> None:
    assert subprocess.check_output([sys.executable, '-c', PROGRAM]).split() == [b'True', b'False', b'False', b'True']
