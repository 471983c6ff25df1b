# SPDX-License-Identifier: BSD-3-Clause
"""What kriging should think of pictures: how their pixels differ over distance, and how well each model fills."""
import numpy as np
from skimage.metrics import peak_signal_noise_ratio

from benchmarks import pictures
from benchmarks.fill import patterns
from smokebot_udp.codecs.concealment.kriging import SMOOTH, kriging_clamped
from smokebot_udp.codecs.wire.interleave import Interleave

from . import drawing, table
from .runner import Figure, Table, again

TITLE = 'The model that missing pixels are filled by'

EXPLANATION = """
Kriging needs to know how much pixels differ over their distance h: the *variogram*. The package takes
sqrt(h² + b²) − b with b = 1 pixel. Here are the true ones of photographs at 320 × 240 and of radiometric recordings at
their own size, and how well both are filled with other lengths b, one for all pictures or the best for each; 64
subimages.
"""

DISTANCES = 1, 2, 3, 4, 6, 8, 12, 16, 24, 32
SHOWN_AS_ONE = 8
"""Variograms are compared at this distance, where all are 1 [pixel]."""

LENGTHS = 0.0, 0.3, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 3.0
LOSSES = 0.1, 0.2, 0.5, 0.8, 0.9
PATTERNS = 6


def variogram(picture):
    """Half the mean squared difference of pixels so far apart in a row or a column: {distance: counts squared}"""
    numbers = picture.astype(float)
    return {h: 0.25 * sum(np.mean((one[h:] - one[:-h]) ** 2) for one in (numbers, numbers.T)) for h in DISTANCES}


def fill_quality(picture, loss, smooth, count):
    """The mean PSNR of so many losses, over the picture's own range [dB]."""
    cut = Interleave(*picture.shape, 3)
    subimages = cut.split(picture)
    depth = 255 if picture.dtype == np.uint8 else int(picture.max()) - int(picture.min())
    return np.mean([peak_signal_noise_ratio(picture, cut.merge(kriging_clamped(subimages, have, cut, smooth)),
                                            data_range=depth) for have in patterns(cut, loss, count)])


def run(run):
    kinds = {'photographs': pictures.grey(320, 240), 'recordings': pictures.thermal()}
    if run.quick:
        kinds = {kind: dict(list(them.items())[::5]) for kind, them in kinds.items()}
    rows = [{'kind': kind, 'picture': name, **variogram(picture)}
            for kind, them in kinds.items() for name, picture in them.items()]
    table.write(run.folder / 'variograms.csv', rows)
    rows = []
    for kind, them in kinds.items():
        for name, picture in run.steps(them.items(), say=lambda item: item[0]):
            rows += [{'kind': kind, 'picture': name, 'lost': loss, 'b': smooth,
                      'psnr': fill_quality(picture, loss, smooth, 2 if run.quick else PATTERNS)}
                     for loss in LOSSES for smooth in LENGTHS]
    table.write(run.folder / 'lengths.csv', rows)


def plot(folder):
    variograms, lengths = table.read(folder / 'variograms.csv'), table.read(folder / 'lengths.csv')
    draw_variograms(variograms, folder / 'variograms.png')
    return [Figure('variograms.png', 'How much pixels differ over their distance, 1 at a distance of %d: half of the '
                   'pictures lie in the shade.' % SHOWN_AS_ONE),
            *(length_table(lengths, kind) for kind in _kinds(lengths))]


def draw_variograms(rows, path):
    kinds, h = _kinds(rows), np.array(DISTANCES)
    figure, axes = drawing.canvas(10, 4, 1, len(kinds), sharey=True)
    for axis, kind in zip(axes, kinds):
        values = np.array([[row[str(distance)] / row[str(SHOWN_AS_ONE)] for distance in DISTANCES]
                           for row in rows if row['kind'] == kind])
        low, median, high = np.percentile(values, (25, 50, 75), axis=0)
        axis.fill_between(h, low, high, color='0.85')
        axis.plot(h, median, '0.4', label='median of %d' % len(values))
        for smooth, style in ((0.0, 'C0:'), (SMOOTH, 'C3--')):
            model = np.sqrt(h ** 2 + smooth ** 2) - smooth
            axis.plot(h, model / model[DISTANCES.index(SHOWN_AS_ONE)], style, label='model, b = %g' % smooth)
        axis.set(title=kind, xlabel='distance [pixel]', xscale='log', yscale='log')
        axis.legend()
    drawing.save(figure, path)


def length_table(rows, kind):
    names = list(dict.fromkeys(row['picture'] for row in rows if row['kind'] == kind))
    psnr = {(row['picture'], row['lost'], row['b']): row['psnr'] for row in rows}
    lines = [['%g' % b] + ['%.2f' % np.mean([psnr[name, loss, b] for name in names]) for loss in LOSSES]
             for b in LENGTHS]
    best = ['the best for each'] + ['%.2f' % np.mean([max(psnr[name, loss, b] for b in LENGTHS) for name in names])
                                    for loss in LOSSES]
    return Table('%d %s: mean PSNR [dB], of a recording over its own range of counts.' % (len(names), kind),
                 ['b [pixel]'] + ['%g %% lost' % (100 * loss) for loss in LOSSES], lines + [best])


def _kinds(rows):
    return list(dict.fromkeys(row['kind'] for row in rows))


again(__name__, plot)
