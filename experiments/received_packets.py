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
    with Crossing(run) as crossing:
        for loss in run.steps(losses, say='{} %'.format):
            heard, state = crossing.measure(WAY, seconds, loss / 100, DELAY)
            masks, pictures = ([h for h in heard if h.topic == topic] for topic, *_ in WAY.wanted)
            packets = [PACKETS * mask.amount for mask in masks]
            rows.append({'loss [%]': loss, 'packets': round(statistics.mean(packets), 3),
                         'p5': np.percentile(packets, 5), 'p95': np.percentile(packets, 95),
                         **summary(pictures, seconds), **state})
            table.write(run.folder / 'packets.csv', rows)


def plot(folder):
    rows = table.read(folder / 'packets.csv')
    losses, packets, rates = ([row[key] for row in rows] for key in ('loss [%]', 'packets', 'rate [Hz]'))
    slope, start, fit = straight_line(losses, packets)
    figure, axes = drawing.canvas(7, 4.2)
    axes.fill_between(losses, [row['p5'] for row in rows], [row['p95'] for row in rows], color=drawing.OURS, alpha=0.15,
                      linewidth=0, label='90 % of the pictures')
    axes.plot(losses, packets, 'o-', color=drawing.OURS, label='measured, mean')
    axes.plot(losses, [PACKETS * (1 - loss / 100) for loss in losses], ':', color=drawing.PAPER,
              label='64 × (1 − loss), as the deliverable tells')
    axes.set(xlabel='packets lost [%]', ylabel='packets received of a picture\'s 64', ylim=(0, 68))
    beside = axes.twinx()
    beside.plot(losses, rates, 's--', color='0.2', markersize=4, label='pictures a second (right)')
    beside.set(ylabel='pictures a second', ylim=(0, RATE * 68 / 64))
    beside.spines['right'].set_visible(True)
    beside.grid(visible=False)
    lines = axes.get_legend_handles_labels(), beside.get_legend_handles_labels()
    axes.legend(*map(sum, zip(*lines), ([], [])), loc='lower left')
    drawing.save(figure, folder / 'packets.png')
    return [Figure('packets.png', 'Packets received of a picture over loss; R² of the straight line is %.5f.' % fit),
            Table('The same in numbers; the line is %.1f − %.3f for each percent lost.' % (start, -slope),
                  ['lost [%]', 'packets of 64', 'pictures a second', 'age p99 [ms]'],
                  [[row['loss [%]'], row['packets'], row['rate [Hz]'], row['age p99 [s]'] * 1e3] for row in rows])]


again(__name__, plot)
