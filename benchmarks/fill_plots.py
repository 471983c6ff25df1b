# SPDX-License-Identifier: BSD-3-Clause
"""What benchmarks/fill.py draws."""
import numpy as np
from matplotlib.figure import Figure

from smokebot_udp.codecs.concealment.fill import METHODS
from smokebot_udp.codecs.wire.interleave import Interleave

LOSSES = 0.5, 0.8
"""Of the sheet."""

CLOSE = 100, 140
"""Rows and columns of the part that the sheet shows: a photograph's middle, a radiometric picture's hottest."""


def plot(quality, goals, path):
    """PSNR and SSIM over loss, a line for each method.

    :param quality: as benchmarks.fill.quality returns it
    :param goals: {loss: PSNR [dB]}
    """
    figure = Figure(figsize=(11, 5))
    for axes, what, unit in zip(figure.subplots(1, 2), ('psnr', 'ssim'), (' [dB]', '')):
        for method, of_losses in quality.items():
            means = [np.mean([measured[what] for measured in of.values()]) for of in of_losses.values()]
            axes.plot([100 * loss for loss in of_losses], means, '.-', label=method)
        if what == 'psnr':
            axes.plot([100 * loss for loss in goals], list(goals.values()), 'k_', markersize=12, label='goal')
        axes.set(xlabel='lost [%]', ylabel=what.upper() + unit)
        axes.grid(True)
        axes.legend()
    figure.tight_layout()
    figure.savefig(str(path), dpi=90)


def sheet(chosen, path):
    """A part of some pictures: a row for each loss, a column for each method.

    :param chosen: {name: (height, width) array}
    """
    names = list(METHODS)
    figure = Figure(figsize=(3 * (len(names) + 1), 2.2 * len(LOSSES) * len(chosen)))
    axes = figure.subplots(len(LOSSES) * len(chosen), len(names) + 1)
    for i, (title, picture) in enumerate(chosen.items()):
        cut = Interleave(*picture.shape, 3)
        subimages = cut.split(picture)
        for j, loss in enumerate(LOSSES):
            have = np.random.RandomState(3).random_sample(len(cut)) >= loss
            shown = [picture] + [cut.merge(METHODS[name](subimages, have, cut)) for name in names]
            titles = ['%s, %g %% lost' % (title, 100 * loss)] + names
            for axis, one, words in zip(axes[i * len(LOSSES) + j], shown, titles):
                _show(axis, one, picture, words)
    figure.tight_layout()
    figure.savefig(str(path), dpi=80, pil_kwargs={'quality': 80})


def _show(axis, picture, original, title):
    centre = np.divmod(original.argmax(), original.shape[1])
    if original.dtype == np.uint8:
        centre = np.array(original.shape) // 2
    top, left = (int(np.clip(at - close // 2, 0, side - close))
                 for at, side, close in zip(centre, original.shape, CLOSE))
    part = np.s_[top:top + CLOSE[0], left:left + CLOSE[1]]
    axis.imshow(picture[part], 'gray' if picture.dtype == np.uint8 else 'inferno', interpolation='nearest',
                vmin=original[part].min(), vmax=original[part].max())
    axis.set_title(title, fontsize=8)
    axis.axis('off')
