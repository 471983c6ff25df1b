# SPDX-License-Identifier: BSD-3-Clause
"""The variogram that kriging assumes: how pixels really differ over distance, and how well each model fills."""
import pathlib
from typing import Callable, Dict, List, Sequence, Union

import numpy as np

from evaluation.losses import patterns
from evaluation.quality import psnr
from evaluation.recordings import photographs, thermal
from smokebot_udp.arrays import Array
from smokebot_udp.codecs.concealment.kriging import SMOOTH, kriging_clamped
from smokebot_udp.codecs.wire.interleave import Interleave

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'The model by which missing pixels are filled'

EXPLANATION = """
Kriging needs to know how much pixels differ over their distance h: the *variogram*. The package assumes
sqrt(h² + b²) − b with b = 1 pixel. Here are the true ones of photographs at 320 × 240 and of radiometric recordings at
their own size, and how well both are filled with other lengths b, one for all images or the best for each; 64
subimages.
"""

DISTANCES = 1, 2, 3, 4, 6, 8, 12, 16, 24, 32
UNIT_DISTANCE = 8
"""Variograms are scaled to 1 at this distance [pixel]."""

LENGTHS = 0.0, 0.3, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 3.0
LOSSES = 0.1, 0.2, 0.5, 0.8, 0.9
PATTERNS, QUICK_PATTERNS = 6, 2
QUICK_STEP = 5
"""A quick run uses every fifth image."""


def variogram(image: Array) -> Dict[int, float]:
    """{distance: half the mean squared difference of pixels at this distance in a row or a column [count²]}"""
    values = image.astype(float)
    return {h: 0.25 * sum(float(np.mean((one[h:] - one[:-h]) ** 2)) for one in (values, values.T)) for h in DISTANCES}


def fill_quality(image: Array, loss: float, smooth: float, count: int) -> float:
    """The mean PSNR over some losses, over the image's own range where it is not of bytes [dB]."""
    height, width = image.shape
    cut = Interleave(height, width, 3)
    subimages = cut.split(image)
    value_range = 255 if image.dtype == np.uint8 else int(image.max()) - int(image.min())
    return float(np.mean([psnr(image, cut.merge(kriging_clamped(subimages, have, cut, smooth)), value_range)
                          for have in patterns(cut, loss, count)]))


def run(run: Run) -> None:
    """Write variograms.csv and lengths.csv."""
    kinds: Dict[str, Dict[str, Array]] = {'photographs': dict(photographs(320, 240)), 'recordings': thermal()}
    if run.quick:
        kinds = {kind: dict(list(images.items())[::QUICK_STEP]) for kind, images in kinds.items()}
    rows = [{'kind': kind, 'picture': name, **variogram(image)}
            for kind, images in kinds.items() for name, image in images.items()]
    table.write(run.folder / 'variograms.csv', rows)
    rows = []
    for kind, images in kinds.items():
        for name, image in run.steps(images.items(), lambda item: item[0]):
            rows += [{'kind': kind, 'picture': name, 'lost': loss, 'b': smooth,
                      'psnr': fill_quality(image, loss, smooth, QUICK_PATTERNS if run.quick else PATTERNS)}
                     for loss in LOSSES for smooth in LENGTHS]
    table.write(run.folder / 'lengths.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure of variograms, and a table of PSNR for each kind of images."""
    variograms, lengths = table.read(folder / 'variograms.csv'), table.read(folder / 'lengths.csv')
    draw_variograms(variograms, folder / 'variograms.png')
    return [Figure('variograms.png', 'How much pixels differ over their distance, scaled to 1 at a distance of %d: '
                   'half of the images lie in the shaded area.' % UNIT_DISTANCE),
            *(length_table(lengths, kind) for kind in _kinds(lengths))]


def draw_variograms(rows: Sequence[table.Row], path: pathlib.Path) -> None:
    """Measured variograms and models, axes for each kind of images."""
    kinds, h = _kinds(rows), np.array(DISTANCES)
    figure, axes = drawing.canvas(10, 4, 1, len(kinds), sharey=True)
    for axis, kind in zip(axes, kinds):
        values = np.array([[row[str(distance)] / row[str(UNIT_DISTANCE)] for distance in DISTANCES]
                           for row in rows if row['kind'] == kind])
        low, median, high = np.percentile(values, (25, 50, 75), axis=0)
        axis.fill_between(h, low, high, color='0.85')
        axis.plot(h, median, '0.4', label='median of %d' % len(values))
        for smooth, style in ((0.0, 'C0:'), (SMOOTH, 'C3--')):
            model = np.sqrt(h ** 2 + smooth ** 2) - smooth
            axis.plot(h, model / model[DISTANCES.index(UNIT_DISTANCE)], style, label='model, b = %g' % smooth)
        axis.set(title=kind, xlabel='distance [pixel]', xscale='log', yscale='log')
        axis.legend()
    drawing.save(figure, path)


def length_table(rows: Sequence[table.Row], kind: str) -> Table:
    """PSNR over loss for each length."""
    names = list(dict.fromkeys(row['picture'] for row in rows if row['kind'] == kind))
    quality = {(row['picture'], row['lost'], row['b']): row['psnr'] for row in rows}
    lines = [['%g' % b] + ['%.2f' % np.mean([quality[name, loss, b] for name in names]) for loss in LOSSES]
             for b in LENGTHS]
    best = ['the best for each'] + ['%.2f' % np.mean([max(quality[name, loss, b] for b in LENGTHS) for name in names])
                                    for loss in LOSSES]
    return Table('%d %s: mean PSNR [dB], of a recording over its own range of counts.' % (len(names), kind),
                 ['b [pixel]'] + ['%g %% lost' % (100 * loss) for loss in LOSSES], [*lines, best])


def _kinds(rows: Sequence[table.Row]) -> List[str]:
    return list(dict.fromkeys(row['kind'] for row in rows))


def _doc_table(kind: str) -> Callable[[pathlib.Path], Table]:
    return lambda folder: length_table(table.read(folder / 'lengths.csv'), kind)


DOC_TABLES = {kind: _doc_table(kind) for kind in ('photographs', 'recordings')}
