# SPDX-License-Identifier: BSD-3-Clause
"""The links of `bench live`: a kernel's shaper or the link lab, and how its commands are written and its counters read.

A shaper's name says what it is: `tbf6` is a token bucket filter with a burst of 6 kB, `htb` a class of a hierarchical
token bucket with the burst that tc chooses, `lab` the link lab with a delay of 20 ms each way, `wifi` the same where
datagrams arrive in aggregates, as over Wi-Fi. A number after a slash is the queue in ms: `tbf6/1000`; without it, 200.
"""
import json
import re
from typing import Any, Dict, List, NamedTuple

from smokebot_udp.link_lab.lab import DEVICE

NAME = re.compile(r'(tbf(?P<burst>\d+(\.\d+)?)|(?P<kind>htb|lab|wifi))(/(?P<queue>\d+(\.\d+)?))?')

DEFAULT_QUEUE = 0.2
"""Queue of a shaper whose name has none [s]."""

LAB_DELAY = 0.02
"""Delay of the link lab, each way [s]."""

AGGREGATE = 0.006
"""Mean time between aggregates of `wifi`, 4 to 8 ms as in traces of access points [s]."""

LEAST_BURST = 1540
"""Burst of `tbf1.5`: a bucket of 1500 bytes drops each full datagram, as the shaper counts its Ethernet header, too
[byte]."""

HTB_FLOOR = 3000
"""The queue of htb holds at least two datagrams [byte]."""


class Shaper(NamedTuple):
    """How a link limits its rate."""
    name: str
    kind: str
    """Kind of the shaper: tbf, htb, lab or wifi."""
    burst: int = 0
    """Burst of a tbf [byte]."""
    queue: float = DEFAULT_QUEUE
    """The longest time that a datagram waits [s]."""

    @property
    def aggregate(self) -> float:
        """The mean time between aggregates in the link lab; 0: there are none [s]."""
        return AGGREGATE if self.kind == 'wifi' else 0.0

    @property
    def in_kernel(self) -> bool:
        """Whether the kernel shapes; otherwise the link lab does."""
        return self.kind in ('tbf', 'htb')


def parse(name: str) -> Shaper:
    """The shaper of a name, see above.

    :raises ValueError: naming what is wrong
    """
    found = NAME.fullmatch(name)
    queue = 1e-3 * float(found.group('queue')) if found and found.group('queue') else DEFAULT_QUEUE
    if not found or not queue:
        raise ValueError('%r is no shaper; there are tbf1.5, tbf6, tbf32, htb, lab, wifi, each with /QUEUE [ms]' % name)
    burst = max(LEAST_BURST, round(1000 * float(found.group('burst')))) if found.group('burst') else 0
    return Shaper(name, found.group('kind') or 'tbf', burst, queue)


def commands(shaper: Shaper, rate: float, verb: str = 'add', name: str = DEVICE) -> List[List[str]]:
    """The command lines that make a kernel's shaper at the robot's end of the link.

    :param rate: [bit/s]
    :param verb: add, or change where there is one already
    :param name: of the device
    """
    device = ['dev', name]
    if shaper.kind == 'tbf':
        return [['tc', 'qdisc', verb, *device, 'root', 'tbf', 'rate', '%dbit' % rate, 'burst', '%db' % shaper.burst,
                 'latency', '%gms' % (1e3 * shaper.queue)]]
    limit = max(HTB_FLOOR, round(rate / 8 * shaper.queue))
    made = [['tc', 'qdisc', 'add', *device, 'root', 'handle', '1:', 'htb', 'default', '1']] if verb == 'add' else []
    return [*made, ['tc', 'class', verb, *device, 'parent', '1:', 'classid', '1:1', 'htb', 'rate', '%dbit' % rate],
            ['tc', 'qdisc', verb, *device, 'parent', '1:1', 'handle', '10:', 'bfifo', 'limit', '%db' % limit]]


def loss_rules(loss: float, device: str = DEVICE) -> str:
    """Rules of nft that lose UDP datagrams as they arrive, independently of each other. They replace those of before.

    The protocol is named by its number: a bare machine has no /etc/protocols.

    :param loss: 0..1
    """
    table = 'table ip losing_' + device
    made = [
        table + ' {', 'chain arriving {', 'type filter hook prerouting priority -300; policy accept;',
        'iifname "%s" ip protocol 17 numgen random mod 1000 < %d drop' % (device, round(1000 * loss)), '}', '}']
    return '\n'.join([table + ' {}', 'delete ' + table, *(made if loss else []), ''])


class Count(NamedTuple):
    """What a shaper has counted since it was made."""
    sent: int
    """[byte]"""
    dropped: int
    """Datagrams that the queue had no place for."""


def counted(text: str) -> Count:
    """The counters of the outermost shaper in the answer of `tc -s -j qdisc show`.

    :raises ValueError: where there is none
    """
    listed: List[Dict[str, Any]] = json.loads(text)
    for qdisc in listed:
        if qdisc.get('root'):
            return Count(qdisc['bytes'], qdisc['drops'] + sum(
                other['drops'] for other in listed if other.get('parent')))
    raise ValueError('no shaper is listed in %r' % text)
