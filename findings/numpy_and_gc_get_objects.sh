#!/usr/bin/env bash
# While one thread counts the objects that Python's garbage collector knows, by len(gc.get_objects()), numpy functions of
# other threads raise "SystemError: ../Objects/tupleobject.c: bad argument to internal function", on valid arguments:
# within seconds where threads take turns often, once in hours otherwise.
#
# Why: numpy builds its result by tuple(generator). CPython fills that tuple while the generator runs, and resizes it at
# the end, which it refuses where somebody else refers to the tuple, too. The list of gc.get_objects() does, for as long
# as it lives.
#
# Seen with CPython 3.11.7 and numpy 1.24.4: after 27 calls of numpy.triu_indices. Program and packages are in a
# temporary folder. It fails where this does not happen in two minutes, or something else is raised.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet install numpy==1.24.4
"$folder/venv/bin/python3" - <<'PROGRAM'
import gc
import platform
import sys
import threading
import time

import numpy as np


def count_objects() -> None:
    while not ended.is_set():
        len(gc.get_objects())


print('CPython %s, numpy %s' % (platform.python_version(), np.__version__))
sys.setswitchinterval(1e-6)     # threads take turns more often than by default, so that it takes seconds, not hours
ended, calls, raised = threading.Event(), 0, ''
counter = threading.Thread(target=count_objects)
counter.start()
deadline = time.monotonic() + 120
while not raised and time.monotonic() < deadline:
    calls += 1
    try:
        np.triu_indices(25, 1)
    except SystemError as error:
        raised = str(error)
ended.set()
counter.join()
print('%d calls of numpy.triu_indices(25, 1), raised: %s' % (calls, raised or 'nothing'))
sys.exit('bad argument to internal function' not in raised)
PROGRAM
