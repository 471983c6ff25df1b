# SPDX-License-Identifier: BSD-3-Clause
"""What the experiment about the needs of streams counts."""
import os
import subprocess
import sys

import pytest

for library in ('cv2', 'psutil'):
    pytest.importorskip(library)

from evaluation.needs_run import SENSORS, Case, processor_time, sent_bytes, stream_settings  # noqa: E402
from experiments.link.needs import CASES  # noqa: E402
from smokebot_udp.nodes.parameters import SIMULATED_ROBOT  # noqa: E402

DEVICES = """Inter-|   Receive                            |  Transmit
 face |bytes packets errs drop fifo frame compressed multicast|bytes packets errs drop fifo colls carrier compressed
    lo:     100    1    0    0    0     0          0         0      200    1    0    0    0     0       0          0
   air: 3000000 2000    0    0    0     0          0         0  4000000 3000    0    0    0     0       0          0
"""


def test_what_a_device_has_sent() -> None:
    assert sent_bytes(DEVICES, 'air') == 4000000 and sent_bytes(DEVICES, 'lo') == 200


def test_children_count() -> None:
    code = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"
    # os.times() counts whole ticks, as /proc does
    busy = 'import os\nwhile sum(os.times()[:2]) < 0.3: pass\nprint(1, flush=True); input()'
    with subprocess.Popen([sys.executable, '-c', code, busy], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None and parent.stdout.readline()
        assert processor_time(parent.pid) >= 0.3
        parent.communicate(b'\n')
    assert processor_time(os.getpid()) > 0


def test_a_robot_has_the_sensors_of_its_streams_only() -> None:
    assert Case('', ['scan'], ['scan'], ['_width:=16']).robot == [
        *('_%s_rate:=0' % name for name in SENSORS if name != 'scan'), '_width:=16']
    assert {name + '_rate' for name in SENSORS} <= set(SIMULATED_ROBOT)
    for case in CASES:
        assert set(stream_settings(case.names)) == set(case.names) and set(case.sensors) <= set(SENSORS)
