# SPDX-License-Identifier: BSD-3-Clause
"""What nodes have registered at the master, and when: a process on the robot's side that asks it, and its reader here.

    python3 -m evaluation.registrations NODE ...

It asks ten times a second, and writes each change as a line of JSON:
[time [s], process id of the master or null, {node: [URI, [names]]}].
"""
import json
import os
import subprocess
import sys
import threading
import time
import xmlrpc.client
from typing import Any, Dict, List, Optional, Sequence

from . import TOP
from .soak import Registered, Registration, registered_at
from .stack import Stack

INTERVAL = 0.1
"""Between two questions [s]."""

CALLER = '/registrations'


class Registrations:
    """The process, and all states that it reported.

    :param stack: the process becomes a part of it
    :param nodes: without the leading slash
    """

    def __init__(self, stack: Stack, nodes: Sequence[str]) -> None:
        self.states: List[Registered] = []
        process = stack.start('robot', sys.executable, '-m', __name__, *nodes, cwd=str(TOP), stdout=subprocess.PIPE,
                              universal_newlines=True)
        assert process.stdout is not None
        self._stdout = process.stdout
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._stdout:
            at, master, nodes = json.loads(line)
            self.states.append(Registered(at, master, {
                node: Registration(uri, set(names)) for node, (uri, names) in nodes.items()}))

    def last(self, parts: Sequence[str], end: float) -> Optional[float]:
        """When the last one of these parts, started at `end`, had registered; None: one has not; `end` without any."""
        last = end
        for part in parts:
            at = registered_at(self.states, part, end)
            if at is None:
                return None
            last = max(last, at)
        return last


def state(master: Any, nodes: Sequence[str]) -> Any:
    """[process id, {node: [URI, [names]]}] of a master."""
    calls = xmlrpc.client.MultiCall(master)
    calls.getPid(CALLER)
    calls.getSystemState(CALLER)
    for node in nodes:
        calls.lookupNode(CALLER, '/' + node)
    answers: Any = calls()
    pid, system = answers[0][2], answers[1][2]
    result: Dict[str, Any] = {}
    for i, node in enumerate(nodes):
        code, _, uri = answers[2 + i]
        if code == 1:
            result[node] = [uri, sorted('%s %s' % (kind, name) for kind, entries in zip(('pub', 'sub', 'srv'), system)
                                        for name, users in entries if '/' + node in users)]
    return [pid, result]


def main() -> None:
    """Run until it is killed."""
    nodes, last = sys.argv[1:], None
    while True:
        try:
            with xmlrpc.client.ServerProxy(os.environ['ROS_MASTER_URI']) as master:
                while True:
                    now = state(master, nodes)
                    if now != last:
                        print(json.dumps([time.time(), *now]), flush=True)
                        last = now
                    time.sleep(INTERVAL)
        except (OSError, xmlrpc.client.Error):
            if last is not None:
                print(json.dumps([time.time(), None, {}]), flush=True)
                last = None
            time.sleep(INTERVAL)


if __name__ == '__main__':
    main()
