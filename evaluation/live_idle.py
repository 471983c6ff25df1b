# SPDX-License-Identifier: BSD-3-Clause
"""What crosses a link of `bench live` beside the image stream, with the nodes as shipped and nothing else to send.

Datagrams and TCP are counted by their ports and their DSCP at the operator's end. With a shared master each part of a
stream has ports of its own; with own masters all has one, but images have a DSCP of their own (traffic.py). So the
largest flow is the images'.
"""
import json
import pathlib
import subprocess
import tempfile
import time
from typing import Any, Dict, Iterator, NamedTuple, Tuple, Type

from smokebot_udp.link_lab.lab import DEVICE, TwoSides

from .live_run import Cell, LiveRun
from .live_score import Row
from .stack import Stack

TABLE = 'flows'
RULES = """
table ip %(table)s {
    set incoming { type inet_proto . inet_service . inet_service . dscp; size 4000; flags dynamic; counter; }
    set outgoing { type inet_proto . inet_service . inet_service . dscp; size 4000; flags dynamic; counter; }
    chain input {
        type filter hook input priority 0; policy accept;
        iifname "%(device)s" update @incoming { ip protocol . th sport . th dport . ip dscp }
    }
    chain output {
        type filter hook output priority 0; policy accept;
        oifname "%(device)s" update @outgoing { ip protocol . th sport . th dport . ip dscp }
    }
}
""" % {'table': TABLE, 'device': DEVICE}

COMPLETE = 10.0
"""What the streams announce of themselves has crossed this long after both sides are there [s]."""

Flow = Tuple[Any, ...]
"""(protocol, source port, destination port, DSCP)"""


def flows(text: str) -> Dict[str, Dict[Flow, int]]:
    """{'incoming' or 'outgoing': {flow: bytes of IP packets}} in the answer of `nft --json list table`."""
    return {entry['set']['name']: {tuple(one['elem']['val']['concat']): one['elem']['counter']['bytes']
                                   for one in entry['set'].get('elem', ())}
            for entry in json.loads(text)['nftables'] if 'set' in entry}


class Moment(NamedTuple):
    """What has crossed until a time, see `flows`."""
    time: float
    """By time.monotonic() [s]."""
    flows: Dict[str, Dict[Flow, int]]

    def since(self, before: 'Moment', way: str, largest: bool = True) -> float:
        """What has crossed since then, a second [kbit/s].

        :param way: incoming or outgoing, as the operator sees it
        :param largest: whether the flow counts that took most
        """
        grown = [count - before.flows[way].get(flow, 0) for flow, count in self.flows[way].items()]
        return 8e-3 * (sum(grown) - (0 if largest else max(grown, default=0))) / (self.time - before.time)


def idle(cell: Cell, masters: Type[Stack]) -> Iterator[Row]:
    """Rows of the table: what crosses without a camera, and beside the images of one.

    At first: until COMPLETE; then: in the cell's seconds after that.
    """
    for camera in (False, True):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            with LiveRun(cell, 'layered', folder, folder / 'nodes.log', masters, camera, begin) as live:
                moments = [Moment(time.monotonic(), {'incoming': {}, 'outgoing': {}})]
                for seconds in (COMPLETE, cell.seconds):
                    time.sleep(seconds)
                    moments.append(counted(live.stack.lab))
        started, complete, ended = moments
        yield {'cell': cell.name, 'link [Mbit/s]': cell.rates[0] / 1e6, 'streams': 'camera' if camera else 'none',
               'to operator at first [kB]': COMPLETE / 8 * complete.since(started, 'incoming', not camera),
               'to operator then [kbit/s]': ended.since(complete, 'incoming', not camera),
               'to robot at first [kB]': COMPLETE / 8 * complete.since(started, 'outgoing'),
               'to robot then [kbit/s]': ended.since(complete, 'outgoing')}


def begin(sides: TwoSides) -> None:
    """Count from now on."""
    sides.run('operator', ['nft', '-f', '-'], input=RULES.encode(), check=True)


def counted(sides: TwoSides) -> Moment:
    """What has crossed until now."""
    answer = sides.run('operator', ['nft', '--json', 'list', 'table', 'ip', TABLE], check=True,
                                stdout=subprocess.PIPE)
    return Moment(time.monotonic(), flows(answer.stdout.decode()))
