# SPDX-License-Identifier: BSD-3-Clause
"""Figures 7 and 8: what TCP and UDP carry over a link with delay and loss."""
import json
import shutil
import subprocess
import time

from smokebot_udp.link_lab.lab import ADDRESSES, Lab

from . import drawing, table
from .crossing import AIR, ATTEMPTS, LATE, lab_state
from .runner import Figure, Skipped, Table, again

TITLE = 'Bandwidth of TCP and UDP (Figures 7 and 8)'

EXPLANATION = """
iperf3 sends over an emulated Wi-Fi link of 54 Mbit/s with a queue of 100 ms: as much as TCP takes, or 20 Mbit/s by UDP.
What TCP takes is a matter of its congestion control. *cubic* was Linux' default at the deliverable's time and is on
most machines: to it a lost packet means congestion, so that it falls rapidly with loss, the more the longer the delay.
*bbr* measures the way instead, and goes on far longer; but a reader of any TCP stream waits for each lost packet to
come again, which this figure does not show. UDP brings what the link does not lose, whatever the delay.

The deliverable says of its Figure 7: high bandwidth without loss even at 50 ms, and a rapid decrease with loss,
especially at higher latencies; and of its Figure 8: 20, 18 and about 16 Mbit/s at 0, 10 and 20 % of loss.
"""

DELAYS, FEW_DELAYS, LOSSES = (0, 2, 10, 20, 50), (2, 50), (0, 1, 2, 5, 10, 20)
"""[ms], of cubic; of the others; [%]"""

QUICK_DELAYS, QUICK_LOSSES = (50,), (0, 10)
KINDS = {'cubic': ['-C', 'cubic'], 'bbr': ['-C', 'bbr'], 'UDP': ['-u', '-b', '20M']}
"""{name: iperf3's arguments}"""

CONNECTED, OMITTED = 0.5, 1
"""The connections are made before there is loss; so much of the beginning does not count [s]."""

PAPER_UDP = {0: 20, 10: 18, 20: 16}
"""{loss [%]: Mbit/s} as the deliverable says of its Figure 8."""


def bandwidth(lab, kind, delay, loss, seconds):
    """What the operator receives [Mbit/s].

    :raises RuntimeError: where iperf3 does not come to an end, or another congestion control was at work
    """
    lab.set({'loss': 0.0, 'delay': delay / 1e3, **AIR})
    server = lab.popen('operator', ['iperf3', '-s', '-1'], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    client = lab.popen('robot', ['iperf3', '-J', '-c', ADDRESSES['operator'], '-t', str(seconds), '-O', str(OMITTED),
                                 *KINDS[kind]], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        time.sleep(CONNECTED)
        lab.set({'loss': loss / 100})
        time.sleep(OMITTED + seconds - CONNECTED / 2)
        lab.set({'loss': 0.0})
        told = json.loads(client.communicate(timeout=20)[0].decode())
    except (subprocess.TimeoutExpired, ValueError) as error:
        raise RuntimeError('iperf3 does not end: %s' % error) from None
    finally:
        for process in (client, server):
            process.kill()
            process.wait()
    if 'error' in told:
        raise RuntimeError('iperf3: ' + told['error'])
    used = told['end'].get('sender_tcp_congestion', kind)
    if used != kind:
        raise RuntimeError('TCP used %s, not %s' % (used, kind))
    return told['end']['sum_received']['bits_per_second'] / 1e6


def cells(quick):
    """(kind, delay [ms], loss [%]) each"""
    for kind in KINDS:
        delays = QUICK_DELAYS if quick else DELAYS if kind == 'cubic' else FEW_DELAYS
        for delay in delays:
            for loss in QUICK_LOSSES if quick else LOSSES:
                yield kind, delay, loss


def measure(lab, kind, delay, loss, seconds):
    """A row of the CSV file; measured again where the machine was busy, or iperf3 did not come to its end."""
    attempt = 0
    while True:
        attempt += 1
        try:
            lab_state(lab)
            carried = bandwidth(lab, kind, delay, loss, seconds)
            state = lab_state(lab)
        except RuntimeError:        # its server may not have listened yet
            if attempt == ATTEMPTS:
                raise
            continue
        if state['late p99 [ms]'] < 1e3 * LATE or attempt == ATTEMPTS:
            return {'kind': kind, 'delay [ms]': delay, 'loss [%]': loss, 'Mbit/s': round(carried, 2), **state,
                    'attempts': attempt}


def run(run):
    if not shutil.which('iperf3'):
        raise Skipped('there is no iperf3: apt install iperf3')
    rows = []
    with Lab(run.seed, 'cubic') as cubic, Lab(run.seed, 'bbr') as bbr:
        for cell in run.steps(cells(run.quick), say=lambda cell: '%s, %d ms, %d %%' % cell):
            rows.append(measure(bbr if cell[0] == 'bbr' else cubic, *cell, seconds=1 if run.quick else 4))
            table.write(run.folder / 'bandwidth.csv', rows)


def plot(folder):
    rows = table.read(folder / 'bandwidth.csv')
    figure, axes = drawing.canvas(12, 4.2, columns=3, sharey=True)
    titles = 'TCP with cubic (Figure 7)', 'TCP with bbr', 'UDP at 20 Mbit/s (Figure 8)'
    for kind, ax, title in zip(KINDS, axes, titles):
        of_kind = [row for row in rows if row['kind'] == kind]
        delays = sorted({row['delay [ms]'] for row in of_kind})
        for i, delay in enumerate(delays):
            line = [row for row in of_kind if row['delay [ms]'] == delay]
            ax.plot([row['loss [%]'] for row in line], [row['Mbit/s'] for row in line], 'o-', markersize=4,
                    color=drawing.WAYS[kind], alpha=1 - 0.8 * i / len(delays), label='%d ms' % delay)
        ax.set(xlabel='packets lost [%]', title=title)
        if kind == 'UDP':
            ax.plot(list(PAPER_UDP), list(PAPER_UDP.values()), 'kx', markersize=9, label='the deliverable')
        ax.legend(title='delay each way')
    axes[0].set_ylabel('received [Mbit/s]')
    drawing.save(figure, folder / 'bandwidth.png')
    losses = sorted({row['loss [%]'] for row in rows})
    return [Figure('bandwidth.png', 'Bandwidth over loss; the paler, the longer the delay.'),
            Table('Mbit/s', ['', 'delay [ms]', *('%d %%' % loss for loss in losses)],
                  [[kind, delay, *(row['Mbit/s'] for row in rows if (row['kind'], row['delay [ms]']) == (kind, delay))]
                   for kind, delay in sorted({(row['kind'], row['delay [ms]']) for row in rows},
                                             key=lambda pair: (list(KINDS).index(pair[0]), pair[1]))])]


again(__name__, plot)
