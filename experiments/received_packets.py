# SPDX-License-Identifier: BSD-3-Clause
"""Figure 10: how many of a picture's packets are received."""
import statistics

import numpy as np

from . import drawing, table
from .crossing import Crossing, Way, summary
from .runner import Figure, Table, again
from .source import RATE
from .straight import straight_line

TITLE = 'Packets received of each picture (Figure 10)'

EXPLANATION = """
A picture of 320 x 240 pixels is sent in 64 packets, as in the deliverable, over a link with 20 ms of delay that loses
more and more of them. Whatever comes makes a picture: the rate stays the source's 10 Hz, and the number of packets in
a picture falls linearly. The deliverable: "Even with a packet loss of 90%, on average six packets are transmitted
successfully". Loss decides how good a picture is, not whether there is one.

That is so where all is sent. By default the robot's rate follows what the operator's side reports, and those reports
cross the same link: the second line tells how well that does where most of them are lost, too.
"""

PACKETS = 64
DELAY = 0.02
"""[s]"""

LOSSES = 0, 1, 2, 5, 10, 20, 30, 40, 50, 60, 70, 80, 90
QUICK_LOSSES = 0, 50, 90

WAY = Way('small/image_raw', [['operator/small/mask', 'mask', 'TCPROS'],
                              ['operator/small/image_raw', 'image', 'TCPROS']])
"""The mask tells of each pixel whether it came, and a packet has 1200 of them."""


def run(run):
    losses, seconds = (QUICK_LOSSES, 1.0) if run.quick else (LOSSES, 6.0)
    rows = []
    for adapt in (False, True):
        with Crossing(run, adapt) as crossing:
            for loss in run.steps(losses, say=('{} %, rate adapted' if adapt else '{} %').format):
                heard, state = crossing.measure(WAY, seconds, loss / 100, DELAY)
                masks, pictures = ([h for h in heard if h.topic == topic] for topic, *_ in WAY.wanted)
                packets = [PACKETS * mask.amount for mask in masks] or [0.0]
                rows.append({'adapt': adapt, 'loss [%]': loss, 'packets': round(statistics.mean(packets), 3),
                             'p5': np.percentile(packets, 5), 'p95': np.percentile(packets, 95),
                             **summary(pictures, seconds), **state})
                table.write(run.folder / 'packets.csv', rows)


def plot(folder):
    rows = table.read(folder / 'packets.csv')
    fixed, adapted = ([row for row in rows if row['adapt'] == adapt] for adapt in (False, True))
    losses, packets, rates = ([row[key] for row in fixed] for key in ('loss [%]', 'packets', 'rate [Hz]'))
    others = {row['loss [%]']: (row['packets'], row['rate [Hz]']) for row in adapted}
    slope, start, fit = straight_line(losses, packets)
    figure, (axes, beside) = drawing.canvas(11, 4.2, columns=2)
    axes.fill_between(losses, [row['p5'] for row in fixed], [row['p95'] for row in fixed], color=drawing.OURS,
                      alpha=0.15, linewidth=0, label='90 % of the pictures')
    axes.plot(losses, packets, 'o-', color=drawing.OURS, label='all is sent')
    axes.plot(losses, [PACKETS * (1 - loss / 100) for loss in losses], ':', color=drawing.PAPER,
              label='64 × (1 − loss), as the deliverable tells')
    beside.plot(losses, rates, 'o-', color=drawing.OURS, label='all is sent')
    for ax, key in ((axes, 'packets'), (beside, 'rate [Hz]')):
        ax.plot([row['loss [%]'] for row in adapted], [row[key] for row in adapted], 's--', color='0.2', markersize=4,
                label='the rate adapted: the default')
        ax.set_xlabel('packets lost [%]')
        ax.legend(loc='lower left')
    axes.set(ylabel='packets', ylim=(0, 68), title='packets received of a picture\'s 64')
    beside.set(ylabel='pictures a second', ylim=(0, RATE * 1.1), title='pictures a second')
    drawing.save(figure, folder / 'packets.png')
    return [Figure('packets.png', 'Over loss. Where all is sent, R² of the straight line is %.5f.' % fit),
            Table('The same in numbers; the line is %.1f − %.3f for each percent lost.' % (start, -slope),
                  ['lost [%]', 'packets of 64', 'pictures a second', 'packets, rate adapted', 'pictures a second'],
                  [[row['loss [%]'], row['packets'], row['rate [Hz]'], *others.get(row['loss [%]'], (None, None))]
                   for row in fixed])]


again(__name__, plot)
