# SPDX-License-Identifier: BSD-3-Clause
"""Figures 2 and 3: images made of some of their 64 subimages."""
import pathlib
from typing import List, Mapping, Sequence, Union

import numpy as np

from evaluation.offline_link import FILLS, Sender, datagram_count, image_message, image_of, image_receiver, received
from evaluation.quality import psnr
from evaluation.recordings import SKIMAGE_PHOTOGRAPHS, photographs
from smokebot_udp.arrays import Array
from smokebot_udp.codecs.wire.interleave import Interleave

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'An image from some of its segments (Figures 2 and 3)'

EXPLANATION = """
An image of 320 × 240 pixels is split into 64 segments of one datagram each. Each segment holds every eighth pixel of
every eighth row, so each shows the whole scene coarsely, and a lost one costs no part of it. Missing pixels are filled
from received ones: by the deliverable with the **nearest**, by this package with **kriging**, the best linear estimate
from the neighbours. The deliverable shows this for three of 64 segments. The received segments are drawn at random.

PSNR is how close an image is to the one that was sent: at 20 dB the scene is recognisable, at 30 dB details are, and
from 40 dB on there is hardly any difference.
"""

FEW = 3
MORE = 6, 13, 32, 58
"""Received segments where 90, 80, 50 and 10 % are lost."""

CURVE = 1, 2, 3, 4, 6, 9, 13, 19, 26, 32, 45, 58, 63
SHOWN = 'camera', 'motorcycle_left'
PAPER_FIRST = list(reversed(list(FILLS)))
DRAWS, QUICK_DRAWS = 10, 2


def run(run: Run) -> None:
    """Fill each image from random segments: psnr.csv, and what is shown in shown.npz."""
    all_photographs = photographs(320, 240)
    names = SHOWN if run.quick else sorted(SKIMAGE_PHOTOGRAPHS)
    random, sender = np.random.RandomState(run.seed), Sender('image', coding='interleaved')
    receivers = {fill: image_receiver(fill) for fill in FILLS}
    rows, shown = [], {}
    for name in run.steps(names, str):
        image = all_photographs[name]
        frames = sender.frames(image_message(image))
        segments = datagram_count(frames)
        for count in sorted({FEW, *MORE, *CURVE}):
            for draw in range(QUICK_DRAWS if run.quick else DRAWS):
                arrived = np.zeros(segments, bool)
                arrived[random.choice(segments, count, replace=False)] = True
                filled = {fill: image_of(received(receivers[fill], frames, arrived)) for fill in FILLS}
                rows += [{'picture': name, 'segments': segments, 'received': count, 'draw': draw, 'fill': fill,
                          'PSNR [dB]': round(psnr(image, filled[fill]), 3)} for fill in filled]
            if name in SHOWN:       # the last draw
                shown.update({'%s %d %s' % (name, count, fill): filled[fill] for fill in filled})
                shown['%s %d came' % (name, count)] = arrived
        shown[name] = image
    table.write(run.folder / 'psnr.csv', rows)
    np.savez_compressed(str(run.folder / 'shown.npz'), **shown)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Images of few and of more segments, and PSNR over their number."""
    rows = table.read(folder / 'psnr.csv')
    with np.load(str(folder / 'shown.npz')) as shown:
        draw_few(rows, shown, folder / 'few.png')
        draw_more(rows, shown, folder / 'more.png')
    draw_curve(rows, folder / 'psnr.png')
    return [
        Figure('few.png', '%d of 64 segments were received. From the left: the image that was sent; the received '
               'pixels; filled as in the deliverable; filled by this package.' % FEW),
        Figure('more.png', 'With more segments more is visible. Above as in the deliverable, below by this package.'),
        Figure('psnr.png', 'The mean quality over images and random losses.')]


def draw_few(rows: Sequence[table.Row], shown: Mapping[str, Array], path: pathlib.Path) -> None:
    """Each image as sent, as received, and filled by each method."""
    figure, grid = drawing.canvas(14, 5.6, len(SHOWN), 2 + len(FILLS))
    for line, name in zip(grid, SHOWN):
        sent, arrived = shown[name], shown['%s %d came' % (name, FEW)]
        drawing.show_image(line[0], sent, 'sent')
        height, width = sent.shape
        only_received = np.where(Interleave(height, width, 3).pixel_mask(arrived), sent, 0)
        drawing.show_image(line[1], only_received, '%d of %d segments received' % (FEW, len(arrived)))
        for axes, fill in zip(line[2:], PAPER_FIRST):
            drawing.show_image(axes, shown['%s %d %s' % (name, FEW, fill)],
                               '%s: %.1f dB' % (FILLS[fill], psnr_of_draws(rows, name, FEW, fill)[-1]))
    drawing.save(figure, path)


def draw_more(rows: Sequence[table.Row], shown: Mapping[str, Array], path: pathlib.Path) -> None:
    """An image of more and more segments, filled by each method."""
    figure, grid = drawing.canvas(14, 5.6, len(FILLS), len(MORE))
    for line, fill in zip(grid, PAPER_FIRST):
        for axes, count in zip(line, MORE):
            drawing.show_image(axes, shown['%s %d %s' % (SHOWN[0], count, fill)], '%d of 64, %s: %.1f dB' % (
                count, fill.split('_')[0], psnr_of_draws(rows, SHOWN[0], count, fill)[-1]))
    drawing.save(figure, path)


def draw_curve(rows: Sequence[table.Row], path: pathlib.Path) -> None:
    """PSNR over the number of segments."""
    figure, axes = drawing.canvas()
    names = {row['picture'] for row in rows}
    for fill, colour in zip(FILLS, (drawing.OURS, drawing.PAPER)):
        axes.plot(CURVE, [np.mean([psnr_of_draws(rows, name, count, fill) for name in names]) for count in CURVE],
                  '.-', color=colour, label=FILLS[fill])
    axes.set(xlabel='received segments of 64', ylabel='PSNR [dB]', xticks=(1, FEW, *MORE))
    axes.legend(loc='upper left')
    drawing.save(figure, path)


def psnr_table(folder: pathlib.Path) -> Table:
    """The mean quality over images and draws."""
    rows = table.read(folder / 'psnr.csv')
    names = {row['picture'] for row in rows}
    counts = (1, FEW, *MORE)
    return Table('PSNR [dB], mean over %d photographs and random losses, by the number of segments that were received '
                 'of 64:' % len(names), ['missing pixels', *map(str, counts)], [
                     [words, *('%.1f' % np.mean([psnr_of_draws(rows, name, count, fill) for name in names])
                               for count in counts)] for fill, words in FILLS.items()])


def psnr_of_draws(rows: Sequence[table.Row], name: str, count: int, fill: str) -> List[float]:
    """PSNR of each random draw of received segments [dB]. The last draw is the one that is shown."""
    return [row['PSNR [dB]'] for row in rows
            if (row['picture'], row['received'], row['fill']) == (name, count, fill)]


DOC_TABLES = {'psnr': psnr_table}
