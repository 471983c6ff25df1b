# SPDX-License-Identifier: BSD-3-Clause
"""link_top --json in a process of its own, without ROS."""
import json
import subprocess
import sys

from smokebot_udp.monitoring.link_board import Board
from smokebot_udp.monitoring.link_snapshot import snapshot

PROGRAM = """
import sys
from smokebot_udp.monitoring.link_board import Board
from smokebot_udp.monitoring.link_snapshot import snapshot
from smokebot_udp.nodes import link_top, terminal
link_top.JSON_PERIOD = 0.01

class Listener:
    def tree(self):
        return snapshot(Board(), 0.0)
terminal.run_node(lambda: link_top.print_objects(Listener()))
"""


def test_an_object_a_line_until_nobody_reads() -> None:
    process = subprocess.Popen([sys.executable, '-c', PROGRAM], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    trees = [json.loads(process.stdout.readline()) for _ in range(3)]
    process.stdout.close()
    assert process.wait(60) == 0 and process.stderr.read() == b''
    process.stderr.close()
    assert trees[0].pop('time') <= trees[1].pop('time') and trees[0] == trees[1] == snapshot(Board(), 0.0)


def test_a_table_whose_reader_has_ended_is_no_error() -> None:
    """As behind `| head -1`: what is printed fills the pipe."""
    program = 'from smokebot_udp.nodes import terminal; terminal.run_node(lambda: print(10 ** 6 * "line\\n") or 0)'
    process = subprocess.Popen([sys.executable, '-c', program], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    assert process.stdout.readline() == b'line\n'
    process.stdout.close()
    assert process.wait(60) == 0 and process.stderr.read() == b''
    process.stderr.close()
