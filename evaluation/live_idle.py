# SPDX-License-Identifier: BSD-3-Clause
"""What crosses a link of `bench live` beside the image stream, with the nodes as shipped and nothing else to send.

Datagrams and TCP are counted by port at the operator's end. With a shared master each stream has a port of its own, so
the largest flow is the image stream's; with own masters there is one port, and only a run without a camera tells.
"""
import json
import pathlib
import subprocess
import tempfile
import time
from typing import Any, Dict, List, Tuple, Type

from smokebot_udp.link_lab.lab import DEVICE

from .live_run import Cell, LiveRun
from .live_score import Row
from .stack import Stack

TABLE = 'flows'
RULES = """
table ip %(table)s {
    set incoming { type inet_proto . inet_service . inet_service; size 4000; flags dynamic; counter; }
    set outgoing { type inet_proto . inet_service . inet_service; size 4000; flags dynamic; counter; }
    chain input {
        type filter hook input priority 0; policy accept;
        iifname "%(device)s" update @incoming { ip protocol . th sport . th dport }
    }
    chain output {
        type filter hook output priority 0; policy accept;
        oifname "%(device)s" update @outgoing { ip protocol . th sport . th dport }
    }
}
""" % {'table': TABLE, 'device': DEVICE}

COMPLETE = 10.0
"""What the streams announce of themselves has crossed by then, after the start [s]."""

Flow = Tuple[Any, ...]
"""(protocol, source port, destination port)"""


def flows(text: str) -> Dict[str, Dict[Flow, int]]:
    """{'incoming' or 'outgoing': {flow: bytes of IP packets}} in the answer of `nft --json list table`."""
    return {entry['set']['name']: {tuple(one['elem']['val']['concat']): one['elem']['counter']['bytes']
                                   for one in entry['set'].get('elem', ())}
            for entry in json.loads(text)['nftables'] if 'set' in entry}


def total(counted: Dict[Flow, int], before: Dict[Flow, int]) -> int:
    """Bytes since an earlier count."""
    return sum(counted.values()) - sum(before.values())


def idle(cell: Cell, masters: Type[Stack]) -> Row:
    """A row of the table: what crosses without a camera.

    :param cell: its rate and its seconds, which begin when the nodes have been there for COMPLETE
    """
    with tempfile.TemporaryDirectory() as folder, LiveRun(
            cell, 'ours', pathlib.Path(folder), pathlib.Path(folder) / 'nodes.log', masters, camera=False) as live:
        sides = live.stack.lab
        sides.run('operator', ['nft', '-f', '-'], input=RULES.encode(), check=True)

        def counted() -> Dict[str, Dict[Flow, int]]:
            return flows(sides.run('operator', ['nft', '--json', 'list', 'table', 'ip', TABLE], check=True,
                                   stdout=subprocess.PIPE).stdout.decode())
        started = counted()
        time.sleep(COMPLETE)
        settled = counted()
        time.sleep(cell.seconds)
        ended = counted()
    if settings_debug:
        print(ended)
    return {'cell': cell.name, 'streams': 'no camera',
            'to operator first 10 s [kbit/s]': 8e-3 * total(settled['incoming'], started['incoming']) / COMPLETE,
            'to operator then [kbit/s]': 8e-3 * total(ended['incoming'], settled['incoming']) / cell.seconds,
            'to robot then [kbit/s]': 8e-3 * total(ended['outgoing'], settled['outgoing']) / cell.seconds}


settings_debug = True
