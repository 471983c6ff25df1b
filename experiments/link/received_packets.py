# SPDX-License-Identifier: BSD-3-Clause
"""Figure 10: the packets that are received of an image."""
import pathlib
from typing import List, Union

import numpy as np

from evaluation.linear_fit import linear_fit
from evaluation.link_run import LinkRun, Method, summary
from evaluation.sensor_source import RATE

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Packets received of each image (Figure 10)'

EXPLANATION = """
An image of 320 x 240 pixels is sent in 64 packets, as in the deliverable, over a link with 20 ms of delay and
increasing loss. Whatever arrives makes an image: the rate stays at the source's 10 Hz, and the number of packets per
image falls linearly. The deliverable: "Even with a packet loss of 90%, on average six packets are transmitted
successfully". Loss determines how good an image is, not whether there is one.

This holds where all packets are sent. By default the robot's rate follows the reports of the operator's side, and those
cross the same link: the second line shows how well this works where most reports are lost, too.
"""

PACKETS = 64
DELAY = 0.02
"""Each way [s]."""

LOSSES = 0, 1, 2, 5, 10, 20, 30, 40, 50, 60, 70, 80, 90
"""[%]"""

QUICK_LOSSES = 0, 50, 90
SECONDS, QUICK_SECONDS = 4.0, 1.0

MASK, IMAGE = 'operator/small/mask', 'operator/small/image_raw'
METHOD = Method('small/image_raw', [[MASK, 'mask', 'TCPROS'], [IMAGE, 'image', 'TCPROS']])
"""The mask says of each pixel whether it was received; a packet has 1200 of them."""


def run(run: Run) -> None:
    """Write packets.csv."""
    losses = QUICK_LOSSES if run.quick else LOSSES
    seconds = QUICK_SECONDS if run.quick else SECONDS
    rows = []
    for adapt in (False, True):
        with LinkRun(run.seed, run.folder / 'nodes.log', run.quick, adapt) as link:
            for loss in run.steps(losses, ('{} %, rate adapted' if adapt else '{} %').format):
                heard, state = link.measure(METHOD, seconds, loss / 100, DELAY)
                packets = [PACKETS * message.amount for message in heard if message.topic == MASK] or [0.0]
                images = [message for message in heard if message.topic == IMAGE]
                rows.append({'adapt': adapt, 'loss [%]': loss, 'packets': round(float(np.mean(packets)), 3),
                             'p5': np.percentile(packets, 5), 'p95': np.percentile(packets, 95),
                             **summary(images, seconds), **state})
                table.write(run.folder / 'packets.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure and a table over loss."""
    rows = table.read(folder / 'packets.csv')
    fixed, adapted = ([row for row in rows if row['adapt'] == adapt] for adapt in (False, True))
    losses, packets, rates = ([row[key] for row in fixed] for key in ('loss [%]', 'packets', 'rate [Hz]'))
    figure, (left, right) = drawing.canvas(11, 4.2, columns=2)
    left.fill_between(losses, [row['p5'] for row in fixed], [row['p95'] for row in fixed], color=drawing.OURS,
                      alpha=0.15, linewidth=0, label='90 % of the images')
    left.plot(losses, packets, 'o-', color=drawing.OURS, label='all is sent')
    left.plot(losses, [PACKETS * (1 - loss / 100) for loss in losses], ':', color=drawing.PAPER,
              label='64 × (1 − loss), as in the deliverable')
    right.plot(losses, rates, 'o-', color=drawing.OURS, label='all is sent')
    for ax, key in ((left, 'packets'), (right, 'rate [Hz]')):
        ax.plot([row['loss [%]'] for row in adapted], [row[key] for row in adapted], 's--', color='0.2', markersize=4,
                label='rate adapted: the default')
        ax.set_xlabel('packets lost [%]')
        ax.legend(loc='lower left')
    left.set(ylabel='packets', ylim=(0, 68), title='packets received of an image\'s 64')
    right.set(ylabel='images per second', ylim=(0, RATE * 1.1), title='images per second')
    drawing.save(figure, folder / 'packets.png')
    return [Figure('packets.png', 'Over loss.'), packets_table(folder)]


def packets_table(folder: pathlib.Path) -> Table:
    """Packets of an image, and images, over loss."""
    rows = table.read(folder / 'packets.csv')
    halves = [[row for row in rows if row['adapt'] == adapt] for adapt in (False, True)]
    losses = [row['loss [%]'] for row in halves[0]]
    fits = [linear_fit(losses, [row['packets'] for row in half])[2] for half in halves]
    lines = []
    for half, words in zip(halves, ('', ', adaptive rate')):
        lines += [['packets of %d%s' % (PACKETS, words), *('%.1f' % row['packets'] for row in half)],
                  ['images per second' + words, *('%.3g' % row['rate [Hz]'] for row in half)]]
    return Table('By the packet loss. Straight lines fit the packets with R² = %.4f and, with an adaptive rate, %.4f.'
                 % (fits[0], fits[1]), ['', *('%d %%' % loss for loss in losses)], lines)


DOC_TABLES = {'packets': packets_table}
