# SPDX-License-Identifier: BSD-3-Clause
import pathlib
import signal
import subprocess
import sys

import pytest

from smokebot_udp.interrupts import ends_silently

SOURCE = pathlib.Path(__file__).resolve().parents[2] / 'src'

PROGRAM = """
import sys, time
sys.path.insert(0, %r)
from smokebot_udp.interrupts import ends_silently
with ends_silently():
    print('imports', flush=True)
    time.sleep(60)
"""


def test_an_interrupted_start_shows_no_traceback() -> None:
    with subprocess.Popen([sys.executable, '-c', PROGRAM % str(SOURCE)], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b'imports\n'
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60) == (b'', b'')
    assert process.returncode == -signal.SIGINT


def test_afterwards_it_raises_as_before() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)     # a shell's background job ignores it
    try:
        with ends_silently():
            pass
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
