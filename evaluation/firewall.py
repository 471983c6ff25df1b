# SPDX-License-Identifier: BSD-3-Clause
"""A firewall on a side of a link lab that passes UDP from the operator to one port of the robot, the answers, and ICMP.

It counts what it passes, and keeps what else was tried. It needs nftables.
"""
import json
import socket
import subprocess
from typing import Any, Dict, List

from smokebot_udp.link_lab.lab import DEVICE, Lab

TABLE = 'port_only'

RULES = """
table ip %(table)s {
    counter passed {}
    counter icmp_packets {}
    counter refused {}
    set tried { type inet_proto . inet_service; size 1000; flags dynamic; }
    chain input {
        type filter hook input priority 0; policy accept;
        iifname != "%(device)s" accept
        ip protocol icmp counter name icmp_packets accept
        %(in)s counter name passed accept
        jump refuse
    }
    chain output {
        type filter hook output priority 0; policy accept;
        oifname != "%(device)s" accept
        ip protocol icmp counter name icmp_packets accept
        %(out)s counter name passed accept
        jump refuse
    }
    chain refuse {
        add @tried { ip protocol . th dport }
        counter name refused drop
    }
}
"""

REQUESTS = 'udp dport %(port)d ct state new,established'
ANSWERS = 'udp sport %(port)d ct state established'
"""The operator speaks first: the robot may only answer where it was asked."""

DIRECTIONS = {'robot': {'in': REQUESTS, 'out': ANSWERS}, 'operator': {'in': ANSWERS, 'out': REQUESTS}}


PROTOCOLS = {socket.IPPROTO_TCP: 'tcp', socket.IPPROTO_UDP: 'udp'}


class Firewall:
    """In force from its construction until the lab is closed.

    :param side: of the lab
    :param port: the robot's
    :raises FileNotFoundError: without nftables
    :raises subprocess.CalledProcessError: where the kernel lacks them
    """

    def __init__(self, lab: Lab, side: str, port: int) -> None:
        self._lab, self._side = lab, side
        rules = RULES % {**{way: rule % {'port': port} for way, rule in DIRECTIONS[side].items()},
                         'table': TABLE, 'device': DEVICE}
        lab.run(side, ['nft', '-f', '-'], input=rules.encode(), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                check=True)

    def _listed(self) -> List[Dict[str, Any]]:
        # by numbers: the names are those of /etc/protocols, which a machine may lack
        done = self._lab.run(self._side, ['nft', '--json', '--numeric', 'list', 'table', 'ip', TABLE],
                             stdout=subprocess.PIPE, check=True)
        listed: List[Dict[str, Any]] = json.loads(done.stdout)['nftables']
        return listed

    def counts(self) -> Dict[str, int]:
        """Packets: {'passed', 'icmp_packets', 'refused'}."""
        return {entry['counter']['name']: entry['counter']['packets'] for entry in self._listed() if 'counter' in entry}

    def tried(self) -> List[str]:
        """What was refused, as 'tcp port 11311': its protocol and the port of its destination."""
        elements = [element for entry in self._listed() if 'set' in entry for element in entry['set'].get('elem', ())]
        return sorted('%s port %s' % (PROTOCOLS.get(int(protocol), protocol), port)
                      for protocol, port in (element['concat'] for element in elements))
