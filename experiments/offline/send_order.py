# SPDX-License-Identifier: BSD-3-Clause
"""The order in which the subimages of an image are sent: the quality of prefixes, and the effect of bursts of loss."""
import pathlib
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Union

import numpy as np

from evaluation.losses import delivered
from evaluation.quality import psnr
from evaluation.recordings import photographs
from evaluation.send_orders import orders
from smokebot_udp.arrays import BoolArray, IntArray, UInt8Array
from smokebot_udp.codecs.concealment.fill import BEST, METHODS
from smokebot_udp.codecs.wire.interleave import Interleave
from smokebot_udp.link_lab.channel import Channel, LinkConditions

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'The order of sending (sections 4.1 and 4.2)'

EXPLANATION = """
Table 3 numbers the subimages, and they are sent in that order. Is there a better one? Photographs at 320 × 240, in 64
or 256 subimages of one datagram each, are filled by the package's own method.

* **Prefixes**: only the first k subimages are sent, as by the link control where the link has no room for more.
* **Bursts**: all are sent, and the link loses datagrams in runs (Gilbert's channel, as in the link lab). What is lost
  together should not lie together in the image. All orders meet the same losses.

The orders: *Z coarse first* is Table 3 with 0 1 / 2 3 in place of Table 2(a); *bits reversed* takes the rows coarse
first, and in each the columns; *farthest point* and *least certain* are greedy, by distance and by kriging's variance;
*golden stride* goes around Table 3 in steps of 0.62 of its length, *random* is one permutation, *by rows* follows the
block's rows.
"""

SIZE = 320, 240
DEPTHS = 3, 4
LOSSES = 0.1, 0.2, 0.5
BURSTS = 0, 2, 4, 8, 16, 32
"""Mean runs of lost datagrams; 0: independent losses."""

PATTERNS, QUICK_PATTERNS = 20, 4
"""Number of consecutive images of each photograph, with losses of their own."""

WORST = 5
"""Percentile of PSNR that stands for bad luck."""

QUICK_STEP = 4
"""A quick run uses every fourth photograph."""

REFERENCE = 'Table 3'
SHOWN_PREFIXES = 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192


def filled_psnr(image: UInt8Array, subimages: UInt8Array, arrived: IntArray, cut: Interleave) -> float:
    """PSNR of an image if the subimages with these indexes arrive [dB]."""
    have = np.zeros(len(cut), bool)
    have[arrived] = True
    return psnr(image, cut.merge(METHODS[BEST](subimages, have, cut)))


def prefixes(images: Mapping[str, UInt8Array], depth: int, seed: int, step: int) -> Iterator[table.Row]:
    """Rows of prefixes.csv: the mean PSNR [dB] for every step-th k."""
    cut = Interleave(SIZE[1], SIZE[0], depth)
    pairs = [(image, cut.split(image)) for image in images.values()]
    for name, order in orders(depth, seed).items():
        for k in sorted({*range(1, min(17, len(cut))), *range(16, len(cut), step)}):
            yield {'depth': depth, 'order': name, 'k': k, 'psnr': float(np.mean(
                [filled_psnr(image, subimages, order[:k], cut) for image, subimages in pairs]))}


def delivered_some(channel: Channel, count: int) -> BoolArray:
    """As `delivered`, but at least one datagram."""
    while True:
        arrived = delivered(channel, count)
        if arrived.any():
            return arrived


def bursts(images: Mapping[str, UInt8Array], loss: float, burst: float, depth: int, seed: int,
           count: int) -> List[table.Row]:
    """Rows of bursts.csv: of each order PSNR, the mean and the percentile WORST [dB]."""
    cut = Interleave(SIZE[1], SIZE[0], depth)
    channel, by_name = Channel(LinkConditions(loss=loss, burst=burst), seed), orders(depth, seed)
    found: Dict[str, List[float]] = {name: [] for name in by_name}
    for image in images.values():
        subimages = cut.split(image)
        for _ in range(count):
            arrived = delivered_some(channel, len(cut))
            for name, order in by_name.items():
                found[name].append(filled_psnr(image, subimages, order[arrived], cut))
    return [{'lost': loss, 'burst': burst, 'order': name, 'psnr': np.mean(values),
             'worst': np.percentile(values, WORST)} for name, values in found.items()]


def run(run: Run) -> None:
    """Write prefixes.csv and bursts.csv."""
    images = photographs(*SIZE)
    if run.quick:
        images = dict(list(images.items())[::QUICK_STEP])
    rows: List[table.Row] = []
    for depth in run.steps(DEPTHS, 'prefixes, depth {}'.format):
        rows += prefixes(images, depth, run.seed, step=4 ** (depth - 2) * (2 if run.quick else 1))
    table.write(run.folder / 'prefixes.csv', rows)
    cells = [(loss, burst) for loss in LOSSES for burst in BURSTS if not burst or burst >= 1 / (1 - loss)]
    rows = []
    for loss, burst in run.steps(cells, lambda cell: '%g lost in runs of %d' % cell):
        rows += bursts(images, loss, burst, DEPTHS[0], run.seed, QUICK_PATTERNS if run.quick else PATTERNS)
    table.write(run.folder / 'bursts.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure and tables of prefixes and of bursts."""
    prefix, burst = table.read(folder / 'prefixes.csv'), table.read(folder / 'bursts.csv')
    draw_prefixes(prefix, folder / 'prefixes.png')
    draw_bursts(burst, folder / 'bursts.png')
    return [
        Figure('prefixes.png', 'The gain of the image of the first k subimages over Table 3 [dB], mean.'),
        *(prefix_table(prefix, depth) for depth in DEPTHS),
        Figure('bursts.png', 'The gain of images over Table 3 where losses come in runs [dB], mean.'),
        *(burst_table(burst, column, caption) for column, caption in (
            ('psnr', 'Mean PSNR [dB] of images whose datagrams are lost in runs; 1: independently.'),
            ('worst', 'The %dth percentile of the PSNR of these images [dB].' % WORST)))]


def draw_prefixes(rows: Sequence[table.Row], path: pathlib.Path) -> None:
    """The gain over k, axes for each depth."""
    figure, axes = drawing.canvas(11, 4.5, 1, len(DEPTHS))
    for axis, depth in zip(axes, DEPTHS):
        by_order = _psnr_by_order([row for row in rows if row['depth'] == depth], 'k')
        for name, values in by_order.items():
            axis.plot(list(values), [values[k] - by_order[REFERENCE][k] for k in values], label=name,
                      color=_colour(name))
        axis.set(xlabel='k of %d' % 4 ** depth, ylabel='over Table 3 [dB]', ylim=(-6, 1), xscale='log')
    axes[0].legend()
    drawing.save(figure, path)


def draw_bursts(rows: Sequence[table.Row], path: pathlib.Path) -> None:
    """The gain over the mean run of lost datagrams, axes for each loss."""
    figure, axes = drawing.canvas(11, 4, 1, len(LOSSES), sharey=True)
    for axis, loss in zip(axes, LOSSES):
        by_order = _psnr_by_order([row for row in rows if row['lost'] == loss], 'burst')
        for name, values in by_order.items():
            axis.plot([max(1, burst) for burst in values],
                      [values[burst] - by_order[REFERENCE][burst] for burst in values], '.-', label=name,
                      color=_colour(name))
        axis.set(title='%g %% lost' % (100 * loss), xlabel='mean run of lost datagrams', xscale='log')
    axes[0].set(ylabel='over Table 3 [dB]')
    axes[-1].legend()
    drawing.save(figure, path)


def prefix_table(rows: Sequence[table.Row], depth: int) -> Table:
    """PSNR over k for each order."""
    by_order = _psnr_by_order([row for row in rows if row['depth'] == depth], 'k')
    shown = [k for k in SHOWN_PREFIXES if k in by_order[REFERENCE]]
    lines = []
    for name, values in by_order.items():
        gains = [values[k] - by_order[REFERENCE][k] for k in values]
        lines.append([name, *('%.2f' % values[k] for k in shown),
                      *('%+.2f' % gain for gain in (np.mean(gains), min(gains), max(gains)))])
    return Table('Mean PSNR [dB] of the first k of %d subimages; the gain over Table 3: on average, and at the k where '
                 'it is least and most.' % 4 ** depth, ['order', *map(str, shown), 'mean', 'least', 'most'], lines)


def burst_table(rows: Sequence[table.Row], column: str, caption: str) -> Table:
    """A column over loss and mean run for each order."""
    cells = [(row['lost'], row['burst']) for row in rows if row['order'] == REFERENCE]
    found = {(row['order'], row['lost'], row['burst']): row[column] for row in rows}
    names = list(dict.fromkeys(row['order'] for row in rows))
    return Table(caption, ['order'] + ['%g %%: %d' % (100 * lost, max(1, burst)) for lost, burst in cells],
                 [[name] + ['%.2f' % found[(name, *cell)] for cell in cells] for name in names])


def doc_prefixes(folder: pathlib.Path) -> Table:
    """prefix_table of 64 subimages."""
    return prefix_table(table.read(folder / 'prefixes.csv'), DEPTHS[0])


def doc_bursts(folder: pathlib.Path) -> Table:
    """burst_table at the higher losses."""
    rows = [row for row in table.read(folder / 'bursts.csv') if row['lost'] in LOSSES[1:]]
    return burst_table(rows, 'psnr', 'Mean PSNR [dB] of images whose datagrams are lost in runs of this mean length:')


DOC_TABLES = {'prefixes': doc_prefixes, 'bursts': doc_bursts}


def _psnr_by_order(rows: Sequence[table.Row], key: str) -> Dict[str, Dict[Any, float]]:
    """{order: {the row's key: its PSNR}}"""
    found: Dict[str, Dict[Any, float]] = {}
    for row in rows:
        found.setdefault(row['order'], {})[row[key]] = row['psnr']
    return found


def _colour(name: str) -> Optional[str]:
    return 'k' if name == REFERENCE else None
