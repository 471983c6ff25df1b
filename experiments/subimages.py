# SPDX-License-Identifier: BSD-3-Clause
"""Pictures made of some of their 64 subimages: Figures 2 and 3."""
import numpy as np
from skimage.metrics import peak_signal_noise_ratio

from benchmarks import pictures
from smokebot_udp.codecs.concealment.temporal import received
from smokebot_udp.codecs.wire.interleave import Interleave

from . import drawing, lossy, table
from .runner import Figure, again

TITLE = 'A picture from some of its segments (Figures 2 and 3)'

EXPLANATION = """
A picture of 320 × 240 pixels is cut into 64 segments of one datagram each. Each holds every eighth pixel of every
eighth row, so each shows the whole scene, coarsely; a lost one costs no part of it. What is missing is filled from
what came: by the deliverable with the **nearest** received pixel, by this package with **kriging**, the best linear
estimate from the received neighbours. The deliverable shows this for three of 64 segments. Which segments come is
drawn at random.

PSNR tells how far a picture is from the one that was sent: at 20 dB one sees what it is, at 30 dB details, from 40 dB
on hardly any difference.
"""

FEW = 3
MORE = 6, 13, 32, 58
"""So many segments are left where 90, 80, 50 and 10 % are lost."""

CURVE = 1, 2, 3, 4, 6, 9, 13, 19, 26, 32, 45, 58, 63
SHOWN = 'camera', 'motorcycle_left'
OLD_FIRST = list(reversed(lossy.FILLS))


def run(run):
    """Fill each picture from random segments; keep what is shown in shown.npz, and PSNRs in psnr.csv."""
    photographs = {name: picture for name, picture in pictures.grey(320, 240).items() if name in pictures.OF_SKIMAGE}
    names = SHOWN if run.quick else sorted(photographs)
    random, sender = np.random.RandomState(run.seed), lossy.robot('image')
    receivers = {fill: lossy.images(fill) for fill in lossy.FILLS}
    rows, shown = [], {}
    for name in run.steps(names, say=str):
        picture = photographs[name]
        frames = sender.frames(lossy.message_of(picture))
        segments = lossy.count(frames)
        for count in sorted({FEW, *MORE, *CURVE}):
            for draw in range(2 if run.quick else 10):
                came = np.zeros(segments, bool)
                came[random.choice(segments, count, replace=False)] = True
                filled = {fill: lossy.picture_of(lossy.came_of(receivers[fill], frames, came)) for fill in lossy.FILLS}
                rows += [{'picture': name, 'segments': segments, 'received': count, 'draw': draw, 'fill': fill,
                          'PSNR [dB]': round(peak_signal_noise_ratio(picture, filled[fill]), 3)} for fill in filled]
            if name in SHOWN:       # the last draw
                shown.update({'%s %d %s' % (name, count, fill): filled[fill] for fill in filled})
                shown['%s %d came' % (name, count)] = came
        shown[name] = picture
    table.write(run.folder / 'psnr.csv', rows)
    np.savez_compressed(str(run.folder / 'shown.npz'), **shown)


def plot(folder):
    rows = table.read(folder / 'psnr.csv')
    with np.load(str(folder / 'shown.npz')) as shown:
        few(rows, shown, folder / 'few.png')
        more(rows, shown, folder / 'more.png')
    curve(rows, folder / 'psnr.png')
    return [
        Figure('few.png', '%d of 64 segments came. From left: the picture that was sent; the pixels that came; '
               'filled as in the deliverable; filled by this package.' % FEW),
        Figure('more.png', 'The more comes, the more is seen. Above as in the deliverable, below by this package.'),
        Figure('psnr.png', 'How good the picture is on average, over pictures and random losses.')]


def few(rows, shown, path):
    figure, grid = drawing.canvas(14, 5.6, len(SHOWN), 2 + len(lossy.FILLS))
    for line, name in zip(grid, SHOWN):
        sent, came = shown[name], shown['%s %d came' % (name, FEW)]
        drawing.picture(line[0], sent, 'sent')
        only_came = np.where(received(came, Interleave(*sent.shape, 3)), sent, 0)
        drawing.picture(line[1], only_came, '%d of %d segments came' % (FEW, len(came)))
        for axes, fill in zip(line[2:], OLD_FIRST):
            drawing.picture(axes, shown['%s %d %s' % (name, FEW, fill)],
                            '%s: %.1f dB' % (lossy.FILLS[fill], psnr(rows, name, FEW, fill)[-1]))
    drawing.save(figure, path)


def more(rows, shown, path):
    figure, grid = drawing.canvas(14, 5.6, len(lossy.FILLS), len(MORE))
    for line, fill in zip(grid, OLD_FIRST):
        for axes, count in zip(line, MORE):
            drawing.picture(axes, shown['%s %d %s' % (SHOWN[0], count, fill)],
                            '%d of 64, %s: %.1f dB' % (count, fill.split('_')[0],
                                                       psnr(rows, SHOWN[0], count, fill)[-1]))
    drawing.save(figure, path)


def curve(rows, path):
    figure, axes = drawing.canvas()
    for fill, colour in zip(lossy.FILLS, (drawing.OURS, drawing.PAPER)):
        names = {row['picture'] for row in rows}
        axes.plot(CURVE, [np.mean([psnr(rows, name, count, fill) for name in names]) for count in CURVE], '.-',
                  color=colour, label=lossy.FILLS[fill])
    axes.set(xlabel='segments that came, of 64', ylabel='PSNR [dB]', xticks=(1, FEW, *MORE))
    axes.legend(loc='upper left')
    drawing.save(figure, path)


def psnr(rows, name, count, fill):
    """[dB], of each draw; the last one is shown."""
    return [row['PSNR [dB]'] for row in rows
            if (row['picture'], row['received'], row['fill']) == (name, count, fill)]


again(__name__, plot)
