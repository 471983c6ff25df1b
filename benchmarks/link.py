# SPDX-License-Identifier: BSD-3-Clause
"""What a link between own masters costs, open and sealed, beside UDPROS over a shared master: CPU time for 1.4 kB.

* Whole transports in two processes, by the frame, at the same rates as in benchmarks/udpros.py; they take turns.
* Sealing and opening alone, in one process, with this interpreter's `cryptography` and with that of Debian's python3;
  and what the tables of a hostile peer cost the robot.
"""
import contextlib
import json
import os
import pathlib
import socket
import subprocess
import sys
from typing import Any, Callable, Dict, List, Optional

from evaluation import TOP
from evaluation.processes import Master, Peer

from . import link_cost
from .udpros import QUICK_ROUNDS, RATES, ROUNDS, Ends, measure, median, pair

UDPROS, LINK = 'UDPROS, shared master', 'link (AES-GCM)'
KEY = '6b' * 32

SIZE = '1350'
"""Size of the messages' data, so that they need one datagram on the link, too [byte]."""

GOAL = 4.0
"""A datagram of the link may cost this much more than one of UDPROS on each side [us]."""

SYSTEM = '/usr/bin/python3'
"""Python interpreter that has Debian's `cryptography`."""

SIDES = {'sender_us': 'sending', 'receiver_us': 'receiving'}


def link_pair(key: str) -> Ends:
    """Start both ends of a link, and wait until they are connected."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        port = str(probe.getsockname()[1])
    script = [sys.executable, '-m', 'benchmarks.link_peer']
    receiver, sender = (Peer([*script, role, port, SIZE, key]) for role in ('receive', 'send'))
    for peer in (receiver, sender):
        assert peer.line() == 'ready'
    return receiver, sender


def system_costs() -> Optional[Dict[str, Any]]:
    """link_cost.costs of Debian's python3; None: it cannot run them."""
    path = os.pathsep.join([str(TOP / 'src'), str(TOP), *filter(None, [os.environ.get('PYTHONPATH')])])
    if not pathlib.Path(SYSTEM).exists():
        return None
    done = subprocess.run([SYSTEM, '-m', link_cost.__name__], cwd=str(TOP), env={**os.environ, 'PYTHONPATH': path},
                          capture_output=True, text=True)
    if done.returncode:
        return None
    costs: Dict[str, Any] = json.loads(done.stdout)
    return costs


def run(log: Callable[[str], None], quick: bool = False) -> Dict[str, Any]:
    """{'transports': {name: {rate: Numbers}}, 'costs': [link_cost.costs, ...]}"""
    with contextlib.ExitStack() as stack:
        stack.enter_context(Master())
        pairs: Dict[str, Ends] = {}
        for name, make in ((UDPROS, lambda: pair('frame', None, SIZE)), (LINK, lambda: link_pair(KEY))):
            pairs[name] = make()
            for peer in pairs[name]:
                stack.callback(peer.close)
        rounds = measure(pairs, QUICK_ROUNDS if quick else ROUNDS, log)
    log('sealing and opening alone')
    costs: List[Optional[Dict[str, Any]]] = [link_cost.costs(), system_costs()]
    return {'transports': {name: {rate: median(rounds[name, rate]) for rate in RATES} for name in pairs},
            'costs': [each for each in costs if each is not None]}


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    lines = ['1.4 kB datagrams over loopback, by the frame: CPU time of each [us]']
    for rate in RATES:
        lines += ['', '%-26s %10s %10s %10s %16s' % (
            'at %d a second' % rate, 'sending', 'receiving', 'p50 [ms]', 'lost')]
        at = {name: numbers[rate] for name, numbers in results['transports'].items()}
        for name, r in at.items():
            lines.append('%-26s %10.2f %10.2f %10s %16s' % (
                name, r['sender_us'], r['receiver_us'], '-' if r['p50'] is None else '%.2f' % (1e3 * r['p50']),
                '%d of %d' % (r['lost'], r['sent'])))
        lines += [more(at, LINK, UDPROS) + ', at most %g' % GOAL]
    lines += ['', 'sealing and opening alone, %d datagrams at a time [us]' % link_cost.FRAME]
    for each in results['costs']:
        lines += ['Python %(python)s, cryptography %(cryptography)s' % each]
        lines += ['    %-22s %10.2f %10.2f' % (link, cost['send'], cost['receive'])
                  for link, cost in each['links'].items()]
        hostile = each['hostile']
        lines.append('    to the robot, from a hostile peer: %s (%.1f times the first)' % (
            ', '.join('%s %.1f' % item for item in hostile.items()),
            hostile[link_cost.FLOODED] / hostile[link_cost.UNKNOWN]))
    return '\n'.join(lines)


def more(at: Dict[str, Any], name: str, base: str) -> str:
    """What one transport costs more than another."""
    return '%s, more than %s: %s' % (name, base, ', '.join(
        '%s %+.2f' % (side, at[name][key] - at[base][key]) for key, side in SIDES.items()))
