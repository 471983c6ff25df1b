# SPDX-License-Identifier: BSD-3-Clause
"""How the experiments' figures look: the same way of sending has the same colour in all of them."""
import matplotlib
from matplotlib.figure import Figure  # without pyplot it needs no screen

matplotlib.rcParams.update({'axes.grid': True, 'grid.alpha': 0.3, 'axes.spines.top': False, 'axes.spines.right': False,
                            'font.size': 10, 'legend.frameon': False, 'lines.linewidth': 1.8, 'savefig.dpi': 110})

OURS = '#d62728'
PAPER = '0.45'
WAYS = {'smokebot_udp': OURS, 'JPEG over TCPROS': '#1f77b4', 'JPEG over UDPROS': '#2ca02c',
        'raw over TCPROS': '#9467bd', 'raw over UDPROS': '#ff7f0e',
        'cloud over TCPROS': '#9467bd', 'cloud over UDPROS': '#ff7f0e', 'cubic': '#1f77b4', 'bbr': '#17becf',
        'UDP': OURS, 'the deliverable': PAPER}
"""{way of sending: colour}"""

PAD = 0.08
"""Around axes, so that no title touches the edge or another row [inch]."""


def canvas(width=8.0, height=4.5, rows=1, columns=1, **options):
    """(figure, its axes as pyplot.subplots returns them); sizes in inches."""
    figure = Figure(figsize=(width, height), layout='constrained')
    figure.get_layout_engine().set(w_pad=PAD, h_pad=PAD)
    return figure, figure.subplots(rows, columns, **options)


def picture(axes, image, title='', **options):
    """Show a picture without axes: grey, the same range as its numbers have, unless the options say otherwise."""
    axes.imshow(image, **{'cmap': 'gray', 'interpolation': 'nearest', **options})
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()


def save(figure, path):
    figure.savefig(str(path))
