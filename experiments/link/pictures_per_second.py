# SPDX-License-Identifier: BSD-3-Clause
"""Figure 9: the rate and the age of images that cross a bad link."""
import pathlib
from itertools import product
from typing import Any, List, Optional, Sequence, Tuple, Union

from evaluation.link_run import IMAGE_METHODS, LinkRun, summary
from evaluation.sensor_source import RATE

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Images per second over a bad link (Figure 9)'

EXPLANATION = """
The ten images per second of a camera, 640 x 480 in grey, cross an emulated Wi-Fi link of 54 Mbit/s, which loses packets
independently and delays all of them, by six methods: as JPEG (quality 80, as `compressed_image_transport` sends it) and
raw, each in one message over ROS' TCP transport and over its UDP transport; and by this package, where no image needs
all of its datagrams: *interleaved*, that is raw pixels, and *layered*, that is compressed and protected for the loss
that was reported, which is the default here. It sends all of them (`adapt` is off). One method at a time, the same
images, TCP with *cubic*. The deliverable's Figure 9 is described in words only: over both transports the rate drops,
with high losses TCP is worse than UDP, raw images over UDP fail from 2 % on, those over TCP at about 20 %, and its own
method stays at 10 Hz.

The figures do not show that on a link without loss all methods bring all images, and that a JPEG takes about a tenth of
the bytes. Of an image of this package in raw pixels at 90 % loss a tenth of the pixels was received, the others are
filled: see Figure 10. *Bytes per image* are those of the message that is published, for this package raw pixels.
"""

LOSSES = 0, 1, 2, 5, 10, 20, 50, 90
"""[%]"""

DELAYS = 2, 50
"""Each way [ms]."""

SECONDS = 3.0
QUICK_LOSSES, QUICK_DELAYS, QUICK_SECONDS = (10, 90), (50,), 1.0
QUICK_METHODS = 'smokebot_udp, interleaved', 'smokebot_udp, layered', 'JPEG over TCPROS', 'JPEG over UDPROS'


def run(run: Run) -> None:
    """Write rates.csv."""
    losses: Sequence[int] = QUICK_LOSSES if run.quick else LOSSES
    delays: Sequence[int] = QUICK_DELAYS if run.quick else DELAYS
    methods = QUICK_METHODS if run.quick else tuple(IMAGE_METHODS)
    seconds = QUICK_SECONDS if run.quick else SECONDS
    rows = []
    with LinkRun(run.seed, run.folder / 'nodes.log', run.quick) as link:
        for delay, name, loss in run.steps(product(delays, methods, losses), lambda cell: '%d ms, %s, %d %%' % cell):
            heard, state = link.measure(IMAGE_METHODS[name], seconds, loss / 100, delay / 1e3)
            rows.append({'way': name, 'delay [ms]': delay, 'loss [%]': loss, **summary(heard, seconds), **state})
            table.write(run.folder / 'rates.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Figures and a table over loss."""
    rows = table.read(folder / 'rates.csv')
    delays, losses = (sorted({row[key] for row in rows}) for key in ('delay [ms]', 'loss [%]'))
    figure, axes = draw(rows, delays, losses, 'rate [Hz]', 1)
    axes[0].set(ylabel='images per second', ylim=(-0.3, RATE * 1.1))
    drawing.save(figure, folder / 'rates.png')
    figure, axes = draw(rows, delays, losses, 'age p99 [s]', 1e3)
    axes[0].set(ylabel='age, p99 [ms]', yscale='log')
    axes[0].yaxis.set_major_formatter('{x:.0f}')
    drawing.save(figure, folder / 'ages.png')
    return [Figure('rates.png', 'Images per second over loss.'),
            Figure('ages.png', 'The age of images when they arrive, 99th percentile. A line ends where no image '
                   'arrives.'),
            rates_table(folder), ages_table(folder)]


def rates_table(folder: pathlib.Path) -> Table:
    """Images per second over loss."""
    return over_loss(folder, 'Images per second, by the packet loss; the delay is one way:', 'rate [Hz]', 1)


def ages_table(folder: pathlib.Path) -> Table:
    """Their ages over loss."""
    return over_loss(folder, 'Median age of the images when they arrive [ms]:', 'age p50 [s]', 1e3)


def over_loss(folder: pathlib.Path, caption: str, key: str, factor: float) -> Table:
    """A column over loss, for each method and delay."""
    rows = table.read(folder / 'rates.csv')
    delays, losses = (sorted({row[key] for row in rows}) for key in ('delay [ms]', 'loss [%]'))
    found = {(row['way'], row['delay [ms]'], row['loss [%]']): row[key] for row in rows}

    def text(value: Optional[float]) -> str:
        return '–' if value is None else ('%.3g' if factor * value < 100 else '%.0f') % (factor * value)
    return Table(caption, ['method', 'delay [ms]', *('%d %%' % loss for loss in losses)], [
        [method, delay, *(text(found[method, delay, loss]) for loss in losses)]
        for method in measured_methods(rows) for delay in delays])


DOC_TABLES = {'rates': rates_table, 'ages': ages_table}


def measured_methods(rows: Sequence[table.Row]) -> List[str]:
    """In the order of IMAGE_METHODS."""
    return [method for method in IMAGE_METHODS if any(row['way'] == method for row in rows)]


def draw(rows: Sequence[table.Row], delays: Sequence[float], losses: Sequence[float], key: str,
         factor: float) -> Tuple[Any, Any]:
    """A figure of a column over loss, and its axes, one for each delay."""
    figure, axes = drawing.canvas(3.3 * len(delays) + 2, 4.2, columns=len(delays), sharey=True, squeeze=False)
    for delay, ax in zip(delays, axes[0]):
        for method in measured_methods(rows):
            cells = [row for row in rows if (row['way'], row['delay [ms]']) == (method, delay)]
            ax.plot([losses.index(row['loss [%]']) for row in cells],
                    [None if row[key] is None else row[key] * factor for row in cells], 'o-', markersize=4,
                    color=drawing.COLOURS[method], label=method, zorder=3 if method.startswith('smokebot_udp') else 2)
        ax.set_xticks(range(len(losses)))
        ax.set_xticklabels(['%d' % loss for loss in losses])
        ax.set(xlabel='packets lost [%]', title='delay %d ms each way' % delay)
    drawing.legend_right(axes[0][-1])
    return figure, axes[0]
