# SPDX-License-Identifier: BSD-3-Clause
"""Figures 7 and 8: the bandwidth of TCP and UDP over a link with delay and loss."""
import json
import pathlib
import shutil
import subprocess
import time
from typing import Dict, Iterator, List, Sequence, Tuple, Union

from evaluation.link_run import AIR, LabBusy, LabWatch, repeated
from smokebot_udp.link_lab.lab import ADDRESSES, Lab

from .. import drawing, table
from ..runner import Figure, Run, Skipped, Table

TITLE = 'Bandwidth of TCP and UDP (Figures 7 and 8)'

EXPLANATION = """
iperf3 sends over an emulated Wi-Fi link of 54 Mbit/s with a queue of 100 ms: as much as TCP takes, or 20 Mbit/s by UDP.
What TCP takes depends on its congestion control. *cubic* was Linux' default at the deliverable's time and is the
default on most machines: it takes a lost packet for congestion, so its rate falls rapidly with loss, the more the
longer the delay. *bbr* measures the path instead, and sustains far higher loss; but a reader of any TCP stream waits
until each lost packet is repeated, which this figure does not show. UDP delivers what the link does not lose, whatever
the delay.

The deliverable says of its Figure 7: high bandwidth without loss even at 50 ms, and a rapid decrease with loss,
especially at higher latencies; and of its Figure 8: 20, 18 and about 16 Mbit/s at 0, 10 and 20 % loss.
"""

CUBIC_DELAYS, DELAYS = (2, 10, 50), (2, 50)
"""Each way, of cubic and of the others [ms]."""

LOSSES = 0, 1, 2, 5, 10, 20
"""[%]"""

SECONDS = 4
QUICK_DELAYS, QUICK_LOSSES, QUICK_SECONDS = (50,), (0, 10), 1
KINDS = {'cubic': ['-C', 'cubic'], 'bbr': ['-C', 'bbr'], 'UDP': ['-u', '-b', '20M']}
"""{name: iperf3's arguments}"""

WORDS = {'cubic': 'TCP, cubic', 'bbr': 'TCP, bbr', 'UDP': 'UDP at 20 Mbit/s'}

CONNECT_TIME, OMITTED = 0.5, 1
"""The connections are made before there is loss; the beginning of the transfer does not count [s]."""

PAPER_UDP = {0: 20, 10: 18, 20: 16}
"""{loss [%]: Mbit/s} of the deliverable's Figure 8."""


class IperfFailed(RuntimeError):
    """iperf3 did not measure."""


def bandwidth(lab: Lab, kind: str, delay: float, loss: float, seconds: int) -> float:
    """What the operator's side receives [Mbit/s].

    :param delay: each way [ms]
    :param loss: [%]
    :raises IperfFailed: where iperf3 does not finish
    :raises RuntimeError: where another congestion control was in use
    """
    lab.set({'loss': 0.0, 'delay': delay / 1e3, **AIR})
    server = lab.popen('operator', ['iperf3', '-s', '-1'], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    client = lab.popen('robot', ['iperf3', '-J', '-c', ADDRESSES['operator'], '-t', str(seconds), '-O', str(OMITTED),
                                 *KINDS[kind]], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        time.sleep(CONNECT_TIME)
        lab.set({'loss': loss / 100})
        time.sleep(OMITTED + seconds - CONNECT_TIME / 2)
        lab.set({'loss': 0.0})
        result = json.loads(client.communicate(timeout=20)[0].decode())
    except (subprocess.TimeoutExpired, ValueError) as error:
        raise IperfFailed('iperf3 does not finish: %s' % error) from None
    finally:
        for process in (client, server):
            process.kill()
            process.wait()
    if 'error' in result:
        raise IperfFailed('iperf3: ' + result['error'])
    used = result['end'].get('sender_tcp_congestion', kind)
    if used != kind:
        raise RuntimeError('TCP used %s, not %s' % (used, kind))
    return float(result['end']['sum_received']['bits_per_second']) / 1e6


def cells(quick: bool) -> Iterator[Tuple[str, int, int]]:
    """What is measured: kind, delay [ms] and loss [%]."""
    losses: Sequence[int] = QUICK_LOSSES if quick else LOSSES
    for kind in KINDS:
        delays: Sequence[int] = QUICK_DELAYS if quick else CUBIC_DELAYS if kind == 'cubic' else DELAYS
        for delay in delays:
            for loss in losses:
                yield kind, delay, loss


def measure(watch: LabWatch, kind: str, delay: int, loss: int, seconds: int) -> table.Row:
    """A row of the CSV file; measured again where the machine was busy, or iperf3 did not finish."""
    def once() -> Tuple[float, Dict[str, float]]:
        watch.forget()
        try:
            return bandwidth(watch.lab, kind, delay, loss, seconds), watch.state()
        except IperfFailed as error:    # its server may not have listened yet
            raise LabBusy(str(error)) from None

    received, state = repeated(once)
    return {'kind': kind, 'delay [ms]': delay, 'loss [%]': loss, 'Mbit/s': round(received, 2), **state}


def run(run: Run) -> None:
    """Write bandwidth.csv."""
    if not shutil.which('iperf3'):
        raise Skipped('there is no iperf3: apt install iperf3')
    rows = []
    with Lab(run.seed, 'cubic') as cubic, Lab(run.seed, 'bbr') as bbr:
        watches = {'cubic': LabWatch(cubic), 'bbr': LabWatch(bbr)}
        for kind, delay, loss in run.steps(cells(run.quick), lambda cell: '%s, %d ms, %d %%' % cell):
            rows.append(measure(watches.get(kind, watches['cubic']), kind, delay, loss,
                                QUICK_SECONDS if run.quick else SECONDS))
            table.write(run.folder / 'bandwidth.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure and a table over loss."""
    rows = table.read(folder / 'bandwidth.csv')
    figure, axes = drawing.canvas(12, 4.2, columns=3, sharey=True)
    titles = 'TCP with cubic (Figure 7)', 'TCP with bbr', 'UDP at 20 Mbit/s (Figure 8)'
    for kind, ax, title in zip(KINDS, axes, titles):
        delays = sorted({row['delay [ms]'] for row in rows if row['kind'] == kind})
        for i, delay in enumerate(delays):
            line = [row for row in rows if (row['kind'], row['delay [ms]']) == (kind, delay)]
            ax.plot([row['loss [%]'] for row in line], [row['Mbit/s'] for row in line], 'o-', markersize=4,
                    color=drawing.COLOURS[kind], alpha=1 - 0.8 * i / len(delays), label='%d ms' % delay)
        ax.set(xlabel='packets lost [%]', title=title)
    axes[2].plot(list(PAPER_UDP), list(PAPER_UDP.values()), 'kx', markersize=9, label='the deliverable')
    for ax in axes:
        ax.legend(title='delay each way')
    axes[0].set_ylabel('received [Mbit/s]')
    drawing.save(figure, folder / 'bandwidth.png')
    return [Figure('bandwidth.png', 'Bandwidth over loss; the paler, the longer the delay.'), received_table(folder)]


def received_table(folder: pathlib.Path) -> Table:
    """What was received over loss."""
    rows = table.read(folder / 'bandwidth.csv')
    losses = sorted({row['loss [%]'] for row in rows})
    found = {(row['kind'], row['delay [ms]'], row['loss [%]']): row['Mbit/s'] for row in rows}
    return Table('Mbit/s received, by the packet loss; the delay is one way:',
                 ['', 'delay [ms]', *('%d %%' % loss for loss in losses)],
                 [[WORDS[kind], delay, *('%.3g' % found[kind, delay, loss] for loss in losses)]
                  for kind, delay in dict.fromkeys((row['kind'], row['delay [ms]']) for row in rows)])


DOC_TABLES = {'received': received_table}
