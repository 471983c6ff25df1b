# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS compared with TCPROS, roscpp and bare sockets: CPU time, highest rate without loss, and latency.

Messages have 1.4 kB. All transports are measured at the same rates, because waking a process costs more than a message,
and at a higher rate more messages share that cost. The transports take turns, so that a busy moment of the machine
affects all of them.
"""
import contextlib
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import matplotlib

from evaluation.processes import Master, Peer

HERE = pathlib.Path(__file__).resolve().parent
RESULTS = HERE.parent / 'results' / 'bench'

MODES = {'rospy TCPROS, queue_size=1000': 'tcp', 'rospy TCPROS, no queue': 'tcp_direct', 'roscpp UDPROS': 'roscpp',
         'ours, by the message': 'message', 'ours, by the frame': 'frame', 'bare sockets (GSO, recvmmsg)': 'bare'}

TABLE_1 = 27000
"""Rate of raw images in Table 1 of deliverable 6.3 [messages/s]."""

RATES, SECONDS, ROUNDS, QUICK_ROUNDS = (5000, TABLE_1), 2, 3, 1
"""CPU time and latency are measured at these rates [messages/s], for this duration [s], in this number of rounds."""

CLIMB, QUICK_CLIMB = (5000, 10000, 15000, 20000, 27000, 40000, 60000, 80000), (TABLE_1,)
"""Rates tried in this order to find the highest one without loss [messages/s]."""

MIN_REACHED = 0.95
"""A sender that reaches a lower share of the requested rate is too slow for it."""

Numbers = Dict[str, Any]
"""What one round measures, see `one_round`."""

Ends = Tuple[Peer, Peer]
"""Receiver and sender."""


def build_roscpp_peer(folder: pathlib.Path) -> Optional[str]:
    """Compile roscpp_peer.cpp; returns its path, or None if roscpp's development files are missing."""
    flags = subprocess.run(['pkg-config', '--cflags', '--libs', 'roscpp'], stdout=subprocess.PIPE,
                           stderr=subprocess.DEVNULL, text=True)
    if flags.returncode:
        return None
    target = str(folder / 'roscpp_peer')
    include = [path + '/include' for path in os.environ.get('CMAKE_PREFIX_PATH', '').split(':')]
    done = subprocess.run(['g++', '-O2', '-o', target, str(HERE / 'roscpp_peer.cpp')]
                          + ['-I' + path for path in include] + flags.stdout.split() + ['-lpthread'],
                          stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return target


def pair(mode: str, roscpp: Optional[str], *size: str) -> Ends:
    """Start both ends of a transport, and wait until they are connected.

    :param size: of the messages' data, if it is not the default [byte]
    """
    # a name's length matters to roscpp: 3 in 54 do not connect (ros_comm#2160)
    topic = '/bench/segments/' + mode
    script = [sys.executable, str(HERE / 'udpros_peer.py')]
    commands = {role: [str(roscpp), role, topic] if mode == 'roscpp' else [*script, role, mode, topic, *size]
                for role in ('receive', 'send')}
    receiver = Peer(commands['receive'])
    if mode == 'bare':
        commands['send'][4] = receiver.line()
    sender = Peer(commands['send'])
    for peer in (receiver, sender):
        assert peer.line() == 'ready'
    return receiver, sender


def one_round(receiver: Peer, sender: Peer, rate: float, seconds: float) -> Numbers:
    """Rates [messages/s], counts, latencies [s], and CPU time per message [us] and per second [cores] of both sides."""
    receiver.ask('begin')
    sent = json.loads(sender.ask('send %g %g' % (rate, seconds)))
    received = json.loads(receiver.ask('report'))
    return {'reached': sent['sent'] / sent['seconds'], 'lost': sent['sent'] - received['received'],
            'sent': sent['sent'], 'p50': received['p50'], 'p99': received['p99'],
            'sender_us': 1e6 * sent['cpu'] / sent['sent'],
            'receiver_us': 1e6 * received['cpu'] / max(1, received['received']),
            'sender_cores': sent['cpu'] / sent['seconds'], 'receiver_cores': received['cpu'] / sent['seconds']}


def run(log: Callable[[str], None], quick: bool = False) -> Dict[str, Any]:
    """{transport: {'at': {rate: Numbers}, 'lossless': messages/s}}"""
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        stack.enter_context(Master())
        roscpp = build_roscpp_peer(pathlib.Path(folder))
        if roscpp is None:
            log('roscpp is skipped: pkg-config does not find it (install libroscpp-dev)')
        pairs: Dict[str, Ends] = {}
        for name, mode in MODES.items():
            if mode != 'roscpp' or roscpp is not None:
                pairs[name] = pair(mode, roscpp)
                for peer in pairs[name]:
                    stack.callback(peer.close)
        rounds = measure(pairs, QUICK_ROUNDS if quick else ROUNDS, log)
        results = {}
        for name, ends in pairs.items():
            log('the highest rate without loss: ' + name)
            results[name] = {'at': {rate: median(rounds[name, rate]) for rate in RATES},
                             'lossless': climb(*ends, QUICK_CLIMB if quick else CLIMB)}
    plot(results)
    return results


def measure(pairs: Dict[str, Ends], count: int, log: Callable[[str], None]) -> Dict[Tuple[str, int], List[Numbers]]:
    """{(transport, rate): [Numbers of each round]}"""
    rounds: Dict[Tuple[str, int], List[Numbers]] = {(name, rate): [] for name in pairs for rate in RATES}
    for ends in pairs.values():
        one_round(*ends, RATES[0], 0.5)     # caches, branch predictors, the processor's clock
    for number in range(count):
        log('round %d of %d' % (number + 1, count))
        for name, rate in rounds:
            rounds[name, rate].append(one_round(*pairs[name], rate, SECONDS))
    return rounds


def median(rounds: List[Numbers]) -> Numbers:
    """The medians of the rounds; of the messages sent and lost, the sums."""
    result = {key: None if rounds[0][key] is None else statistics.median(r[key] for r in rounds) for key in rounds[0]}
    result.update({key: sum(r[key] for r in rounds) for key in ('sent', 'lost')})
    return result


def climb(receiver: Peer, sender: Peer, rates: Sequence[int]) -> int:
    """The highest rate reached without loss [messages/s]. Each is tried twice, as the machine may be busy."""
    lossless = 0
    for rate in rates:
        for _ in range(2):
            attempt = one_round(receiver, sender, rate, 1.0)
            if attempt['lost'] == 0 and attempt['reached'] > MIN_REACHED * rate:
                lossless = rate
                break
        else:
            break
    return lossless


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    lines = ['1.4 kB messages over loopback']
    for rate in RATES:
        lines += ['', '%-30s %12s %12s %14s %10s %10s %16s' % (
            'at %d messages/s' % rate, 'reached [1/s]', 'sender [us]', 'receiver [us]', 'p50 [ms]', 'p99 [ms]', 'lost')]
        for name, result in results.items():
            r = result['at'][rate]
            ages = ['-' if r[key] is None else '%.2f' % (1e3 * r[key]) for key in ('p50', 'p99')]
            lines.append('%-30s %12d %12.2f %14.2f %10s %10s %16s' % (
                name, r['reached'], r['sender_us'], r['receiver_us'], ages[0], ages[1],
                '%d of %d' % (r['lost'], r['sent'])))
        if 'roscpp UDPROS' in results:
            base = results['roscpp UDPROS']['at'][rate]
            for name in ('ours, by the message', 'ours, by the frame'):
                r = results[name]['at'][rate]
                lines.append("%s: %.2f of roscpp's CPU sending, %.2f receiving" % (
                    name, r['sender_us'] / base['sender_us'], r['receiver_us'] / base['receiver_us']))
    lines += ['', 'without loss [messages/s]: ' + '; '.join(
        '%s %d' % (name, result['lossless']) for name, result in results.items())]
    frame = results['ours, by the frame']['at'][TABLE_1]
    lines.append('Table 1 raw, by the frame: %d messages/s on %.2f cores sending, %.2f receiving, %d of %d lost' % (
        frame['reached'], frame['sender_cores'], frame['receiver_cores'], frame['lost'], frame['sent']))
    lines.append('plot: %s' % (RESULTS / 'udpros.png').relative_to(HERE.parent))
    return '\n'.join(lines)


def plot(results: Dict[str, Any]) -> None:
    """Write bars of both sides' CPU time at each rate to results/bench/udpros.png."""
    matplotlib.use('Agg')
    from matplotlib import pyplot
    RESULTS.mkdir(parents=True, exist_ok=True)
    figure, panels = pyplot.subplots(1, len(RATES), figsize=(13, 3.6), sharey=True)
    names = list(results)[::-1]
    for axes, rate in zip(panels, RATES):
        for offset, side in ((0.2, 'sender'), (-0.2, 'receiver')):
            values = [results[name]['at'][rate][side + '_us'] for name in names]
            bars = axes.barh([i + offset for i in range(len(names))], values, 0.38, label=side)
            axes.bar_label(bars, ['%.1f' % value for value in values], padding=3)
        axes.set_yticks(range(len(names)))
        axes.set_yticklabels(names)
        axes.margins(x=0.12)
        axes.set_title('%d messages/s requested' % rate)
        axes.set_xlabel('CPU for each 1.4 kB message [us]')
    panels[-1].legend()
    figure.tight_layout()
    figure.savefig(str(RESULTS / 'udpros.png'), dpi=110)
    pyplot.close(figure)
