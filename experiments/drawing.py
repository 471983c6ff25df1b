# SPDX-License-Identifier: BSD-3-Clause
"""The style of the figures: a method of sending has the same colour in all of them."""
import pathlib
from typing import Any, Tuple

import matplotlib
from matplotlib.figure import Figure  # pyplot would need a display

from smokebot_udp.arrays import Array

matplotlib.rcParams.update({'axes.grid': True, 'grid.alpha': 0.3, 'axes.spines.top': False, 'axes.spines.right': False,
                            'font.size': 10, 'legend.frameon': False, 'lines.linewidth': 1.8, 'savefig.dpi': 110})

OURS = '#d62728'
LAYERED = '#e377c2'
PAPER = '0.45'
COLOURS = {'smokebot_udp': OURS, 'smokebot_udp, interleaved': '#8c564b', 'smokebot_udp, layered': LAYERED,
           'JPEG over TCPROS': '#1f77b4', 'JPEG over UDPROS': '#2ca02c',
           'raw over TCPROS': '#9467bd', 'raw over UDPROS': '#ff7f0e',
           'cloud over TCPROS': '#9467bd', 'cloud over UDPROS': '#ff7f0e', 'cubic': '#1f77b4', 'bbr': '#17becf',
           'UDP': OURS, 'the deliverable': PAPER}
"""{method of sending: colour}"""

PAD = 0.08
"""Around axes, so that no title touches the edge or another row [inch]."""


def canvas(width: float = 8.0, height: float = 4.5, rows: int = 1, columns: int = 1, **options: Any) -> Tuple[Any, Any]:
    """A figure of this size [inch], and its axes as pyplot.subplots returns them."""
    # not layout=: matplotlib has it from 3.6 on
    figure = Figure(figsize=(width, height), constrained_layout={'w_pad': PAD, 'h_pad': PAD})
    return figure, figure.subplots(rows, columns, **options)


def show_image(axes: Any, image: Array, title: str = '', **options: Any) -> None:
    """Show an image without axes, in grey over the range of its values unless the options of imshow say otherwise."""
    axes.imshow(image, **{'cmap': 'gray', 'interpolation': 'nearest', **options})
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()


def legend_right(axes: Any) -> None:
    """Place the legend to the right of the axes."""
    axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))


def save(figure: Any, path: pathlib.Path) -> None:
    """Write a PNG file."""
    figure.savefig(str(path))
