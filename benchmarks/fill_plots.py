# SPDX-License-Identifier: BSD-3-Clause
"""The figures of benchmarks/fill.py."""
import pathlib
from typing import Any, Mapping

import numpy as np
from matplotlib.figure import Figure

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.concealment.fill import METHODS
from smokebot_udp.codecs.wire.interleave import Interleave

LOSSES = 0.5, 0.8
"""Packet-loss ratios that the sheet shows."""

CROP = 100, 140
"""Rows and columns that the sheet shows: a photograph's middle, or the hottest part of a radiometric image."""


def plot(quality: Mapping[str, Mapping[float, Mapping[str, Mapping[str, float]]]], goals: Mapping[float, float],
         path: pathlib.Path) -> None:
    """PSNR and SSIM over loss, a line for each method.

    :param quality: see benchmarks.fill.measure_quality
    :param goals: {loss: PSNR [dB]}
    """
    figure = Figure(figsize=(11, 5))
    grid: Any = figure.subplots(1, 2)
    for axes, measure, unit in zip(grid, ('psnr', 'ssim'), (' [dB]', '')):
        for method, of_losses in quality.items():
            means = [np.mean([measured[measure] for measured in of.values()]) for of in of_losses.values()]
            axes.plot([100 * loss for loss in of_losses], means, '.-', label=method)
        if measure == 'psnr':
            axes.plot([100 * loss for loss in goals], list(goals.values()), 'k_', markersize=12, label='goal')
        axes.set(xlabel='lost [%]', ylabel=measure.upper() + unit)
        axes.grid(True)
        axes.legend()
    figure.tight_layout()
    figure.savefig(str(path), dpi=90)


def sheet(images: Mapping[str, Array], path: pathlib.Path) -> None:
    """A part of some images: a row for each loss, a column for each method.

    :param images: {name: (height, width) array}
    """
    names = list(METHODS)
    figure = Figure(figsize=(3 * (len(names) + 1), 2.2 * len(LOSSES) * len(images)))
    axes: Any = figure.subplots(len(LOSSES) * len(images), len(names) + 1)
    for i, (title, image) in enumerate(images.items()):
        height, width = image.shape
        cut = Interleave(height, width, 3)
        subimages = cut.split(image)
        for j, loss in enumerate(LOSSES):
            have = np.random.RandomState(3).random_sample(len(cut)) >= loss
            shown = [image] + [cut.merge(METHODS[name](subimages, have, cut)) for name in names]
            titles = ['%s, %g %% lost' % (title, 100 * loss), *names]
            for axis, one, words in zip(axes[i * len(LOSSES) + j], shown, titles):
                _show(axis, one, image, words)
    figure.tight_layout()
    figure.savefig(str(path), dpi=80, pil_kwargs={'quality': 80})


def _show(axis: Any, image: Array, original: Array, title: str) -> None:
    centre = np.array(np.divmod(original.argmax(), original.shape[1]))
    if original.dtype == np.uint8:
        centre = np.array(original.shape) // 2
    top, left = (int(np.clip(at - size // 2, 0, side - size))
                 for at, side, size in zip(centre, original.shape, CROP))
    part = np.s_[top:top + CROP[0], left:left + CROP[1]]
    axis.imshow(image[part], 'gray' if image.dtype == np.uint8 else 'inferno', interpolation='nearest',
                vmin=original[part].min(), vmax=original[part].max())
    axis.set_title(title, fontsize=8)
    axis.axis('off')
