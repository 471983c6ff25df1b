# SPDX-License-Identifier: BSD-3-Clause
"""Figure 9: how many pictures a second come over a bad link, and how old they are."""
from itertools import product

from . import drawing, table
from .crossing import PICTURES, Crossing, summary
from .runner import Figure, Table, again
from .source import RATE

TITLE = 'Pictures per second over a bad link (Figure 9)'

EXPLANATION = """
A camera takes ten pictures a second, 640 x 480 grey ones. They cross an emulated Wi-Fi link of 54 Mbit/s, which loses
packets independently and delays all, in five ways: as JPEG (quality 80: what `compressed_image_transport` sends) and
as they are, each over ROS' TCP transport and, whole, over its UDP transport; and by this package, which sends pixels
unchanged, too, but so that each datagram is of use without the others, all of them at once (`adapt` is off). One way
at a time, the same pictures, TCP with *cubic*. The deliverable's Figure 9 has a text only: over both transports the
rate drops, with high losses TCP is worse than UDP, raw pictures over UDP fail from 2 % on, those over TCP at about 20
%, and its own method stays at 10 Hz.

What the figures do not show: on a link without loss all ways bring all pictures, and a JPEG takes about a tenth of
the bytes. What this package shows at 90 % loss has a tenth of its pixels measured, the others filled: see Figure 10.
"""

LOSSES = 0, 1, 2, 5, 10, 20, 50, 90
DELAYS = 2, 20, 50
SECONDS = 3.0
QUICK_LOSSES, QUICK_DELAYS, QUICK_SECONDS = (10, 90), (50,), 1.0
QUICK_WAYS = 'smokebot_udp', 'JPEG over TCPROS', 'JPEG over UDPROS'


def run(run):
    losses, delays, seconds = (QUICK_LOSSES, QUICK_DELAYS, QUICK_SECONDS) if run.quick else (LOSSES, DELAYS, SECONDS)
    rows = []
    with Crossing(run) as crossing:
        cells = list(product(delays, QUICK_WAYS if run.quick else PICTURES, losses))
        for delay, name, loss in run.steps(cells, say=lambda cell: '%d ms, %s, %d %%' % cell):
            heard, state = crossing.measure(PICTURES[name], seconds, loss / 100, delay / 1e3)
            rows.append({'way': name, 'delay [ms]': delay, 'loss [%]': loss, **summary(heard, seconds), **state})
            table.write(run.folder / 'rates.csv', rows)


def plot(folder):
    rows = table.read(folder / 'rates.csv')
    delays, losses = (sorted({row[key] for row in rows}) for key in ('delay [ms]', 'loss [%]'))
    rates, ages = (draw(rows, delays, losses, key, factor) for key, factor in (('rate [Hz]', 1), ('age p99 [s]', 1e3)))
    rates[1][0].set(ylabel='pictures a second', ylim=(-0.3, RATE * 1.1))
    ages[1][0].set(ylabel='age, p99 [ms]', yscale='log')
    ages[1][0].yaxis.set_major_formatter('{x:.0f}')
    for (figure, _), name in ((rates, 'rates.png'), (ages, 'ages.png')):
        drawing.save(figure, folder / name)
    delay = max(delays)
    worst = {way: [row for row in rows if (row['way'], row['delay [ms]']) == (way, delay)] for way in ways(rows)}
    return [Figure('rates.png', 'Pictures a second over loss.'),
            Figure('ages.png', 'How old the pictures are when they come: of a hundred, ninety-nine are younger. A '
                   'line ends where no picture came.'),
            Table('Pictures a second at a delay of %d ms.' % delay,
                  ['way', *('%d %%' % loss for loss in losses), 'bytes a picture'],
                  [[way, *(row['rate [Hz]'] for row in cells), int(cells[0]['amount'] or 0)]
                   for way, cells in worst.items()])]


def ways(rows):
    """Those that were measured, in order."""
    return [way for way in PICTURES if any(row['way'] == way for row in rows)]


def draw(rows, delays, losses, key, factor):
    """(figure, axes): a column of the rows over loss, an axes for each delay."""
    figure, axes = drawing.canvas(3.3 * len(delays) + 2, 4.2, columns=len(delays), sharey=True, squeeze=False)
    for delay, ax in zip(delays, axes[0]):
        for way in ways(rows):
            cells = [row for row in rows if (row['way'], row['delay [ms]']) == (way, delay)]
            ax.plot([losses.index(row['loss [%]']) for row in cells],
                    [None if row[key] is None else row[key] * factor for row in cells], 'o-', markersize=4,
                    color=drawing.WAYS[way], label=way, zorder=3 if way == 'smokebot_udp' else 2)
        ax.set_xticks(range(len(losses)), ['%d' % loss for loss in losses])
        ax.set(xlabel='packets lost [%]', title='delay %d ms each way' % delay)
    axes[0][-1].legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    return figure, axes[0]


again(__name__, plot)
