# SPDX-License-Identifier: BSD-3-Clause
"""In which order the subimages of a picture are best sent: by how good a prefix is, and what bursts of loss do."""
import statistics

import numpy as np

from benchmarks import pictures
from smokebot_udp.codecs.concealment.fill import BEST, METHODS
from smokebot_udp.codecs.wire.interleave import Interleave
from smokebot_udp.link_lab.channel import Channel, Quality

from . import drawing, table
from .orders import orders
from .runner import Figure, Table, again

TITLE = 'The order of sending (sections 4.1 and 4.2)'

EXPLANATION = """
Table 3 numbers the subimages, and they are sent in that order. Is there a better one? Photographs at 320 × 240, in 64
or 256 subimages of which each is a datagram, are filled by the package's own method.

* **Prefixes**: only the first k subimages are sent, as the supervisor does where the link has no room for more.
* **Bursts**: all are sent, and the link loses datagrams in runs (Gilbert's channel, as the link lab has it). What is
  lost together should not lie together in the picture. All orders meet the same losses.

The orders: *Z coarse first* is Table 3 with 0 1 / 2 3 in place of Table 2(a); *bits reversed* takes the rows coarse
first, and in each the columns; *farthest point* and *least certain* are greedy, by distance and by kriging's variance;
*golden stride* goes around Table 3 in steps of 0.62 of its length, *random* is one permutation, *by rows* goes along
the block's rows.
"""

SIZE = 320, 240
DEPTHS = 3, 4
LOSSES = 0.1, 0.2, 0.5
BURSTS = 0, 2, 4, 8, 16, 32
"""Mean runs of lost datagrams; 0: independent losses."""

PATTERNS = 20
"""For each photograph: losses of so many pictures, one after the other."""

WORST = 5
"""So many of a hundred pictures are worse than what is told of the worst."""


def prefixes(photographs, depth, seed, step):
    """[{'depth', 'order', 'k', 'psnr': mean [dB]}]: for every step-th k."""
    cut = Interleave(SIZE[1], SIZE[0], depth)
    subimages = {name: cut.split(picture) for name, picture in photographs.items()}
    for name, order in orders(depth, seed).items():
        for k in sorted({*range(1, min(17, len(cut))), *range(16, len(cut), step)}):
            have = np.zeros(len(cut), bool)
            have[order[:k]] = True
            yield {'depth': depth, 'order': name, 'k': k, 'psnr': statistics.mean(
                pictures.psnr(picture, cut.merge(METHODS[BEST](subimages[of], have, cut)))
                for of, picture in photographs.items())}


def came(channel, count):
    """Which of so many datagrams came, sent one after the other: (count,) bool, one of them at least."""
    while True:
        arrived = np.array([bool(channel.fate(0.0, 1)) for _ in range(count)])
        if arrived.any():
            return arrived


def bursts(photographs, loss, burst, depth, seed, count):
    """[{'lost', 'burst', 'order', 'psnr': mean [dB], 'worst': of few it is less [dB]}]"""
    cut = Interleave(SIZE[1], SIZE[0], depth)
    channel, ways = Channel(Quality(loss=loss, burst=burst), seed), orders(depth, seed)
    found = {name: [] for name in ways}
    for picture in photographs.values():
        subimages = cut.split(picture)
        for _ in range(count):
            arrived = came(channel, len(cut))
            for name, order in ways.items():
                have = np.zeros(len(cut), bool)
                have[order[arrived]] = True
                found[name].append(pictures.psnr(picture, cut.merge(METHODS[BEST](subimages, have, cut))))
    return [{'lost': loss, 'burst': burst, 'order': name, 'psnr': np.mean(of), 'worst': np.percentile(of, WORST)}
            for name, of in found.items()]


def run(run):
    photographs = pictures.grey(*SIZE)
    if run.quick:
        photographs = dict(list(photographs.items())[::4])
    rows = []
    for depth in run.steps(DEPTHS, say=lambda depth: 'prefixes, depth %d' % depth):
        rows += prefixes(photographs, depth, run.seed, step=4 ** (depth - 2) * (2 if run.quick else 1))
    table.write(run.folder / 'prefixes.csv', rows)
    cells = [(loss, burst) for loss in LOSSES for burst in BURSTS if not burst or burst >= 1 / (1 - loss)]
    rows = []
    for loss, burst in run.steps(cells, say=lambda cell: '%g lost in runs of %d' % cell):
        rows += bursts(photographs, loss, burst, DEPTHS[0], run.seed, 4 if run.quick else PATTERNS)
    table.write(run.folder / 'bursts.csv', rows)


def plot(folder):
    prefix, burst = table.read(folder / 'prefixes.csv'), table.read(folder / 'bursts.csv')
    draw_prefixes(prefix, folder / 'prefixes.png')
    draw_bursts(burst, folder / 'bursts.png')
    return [
        Figure('prefixes.png', 'How much better the picture of the first k subimages is than with Table 3 [dB], mean.'),
        *(prefix_table(prefix, depth) for depth in DEPTHS),
        Figure('bursts.png', 'How much better pictures are than with Table 3 where losses come in runs [dB], mean.'),
        *(burst_table(burst, what, caption) for what, caption in (
            ('psnr', 'Mean PSNR [dB] of pictures whose datagrams are lost in runs; 1: independently.'),
            ('worst', 'The PSNR that %d %% of these pictures fall short of [dB].' % WORST)))]


def draw_prefixes(rows, path):
    figure, axes = drawing.canvas(11, 4.5, 1, len(DEPTHS))
    for axis, depth in zip(axes, DEPTHS):
        psnrs = _columns([row for row in rows if row['depth'] == depth], 'k')
        for name, of in psnrs.items():
            axis.plot(list(of), [of[k] - psnrs['Table 3'][k] for k in of], label=name, color=_colour(name))
        axis.set(xlabel='k of %d' % 4 ** depth, ylabel='over Table 3 [dB]', ylim=(-6, 1), xscale='log')
    axes[0].legend()
    drawing.save(figure, path)


def draw_bursts(rows, path):
    figure, axes = drawing.canvas(11, 4, 1, len(LOSSES), sharey=True)
    for axis, loss in zip(axes, LOSSES):
        psnrs = _columns([row for row in rows if row['lost'] == loss], 'burst')
        for name, of in psnrs.items():
            axis.plot([max(1, burst) for burst in of], [of[burst] - psnrs['Table 3'][burst] for burst in of], '.-',
                      label=name, color=_colour(name))
        axis.set(title='%g %% lost' % (100 * loss), xlabel='mean run of lost datagrams', xscale='log')
    axes[0].set(ylabel='over Table 3 [dB]')
    axes[-1].legend()
    drawing.save(figure, path)


def prefix_table(rows, depth):
    psnrs = _columns([row for row in rows if row['depth'] == depth], 'k')
    shown = [k for k in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192) if k in psnrs['Table 3']]
    over = {name: [of[k] - psnrs['Table 3'][k] for k in of] for name, of in psnrs.items()}
    return Table('Mean PSNR [dB] of the first k of %d subimages; over Table 3: in the mean, and at the k where it is '
                 'least and most.' % 4 ** depth, ['order'] + shown + ['mean', 'least', 'most'],
                 [[name] + ['%.2f' % of[k] for k in shown] + [
                     '%+.2f' % extreme(over[name]) for extreme in (statistics.mean, min, max)]
                  for name, of in psnrs.items()])


def burst_table(rows, what, caption):
    cells = [(row['lost'], row['burst']) for row in rows if row['order'] == 'Table 3']
    found = {(row['order'], row['lost'], row['burst']): row[what] for row in rows}
    names = list(dict.fromkeys(row['order'] for row in rows))
    return Table(caption, ['order'] + ['%g %%: %d' % (100 * lost, max(1, burst)) for lost, burst in cells],
                 [[name] + ['%.2f' % found[(name, *cell)] for cell in cells] for name in names])


def _columns(rows, key):
    """{order: {row's key: its PSNR}}"""
    found = {}
    for row in rows:
        found.setdefault(row['order'], {})[row[key]] = row['psnr']
    return found


def _colour(name):
    return 'k' if name == 'Table 3' else None


again(__name__, plot)
