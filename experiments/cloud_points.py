# SPDX-License-Identifier: BSD-3-Clause
"""Figure 11: how many points of a cloud are received."""
import statistics
from itertools import product

from . import drawing, table
from .crossing import Crossing, Way, summary
from .runner import Figure, Table, again
from .source import RATE
from .straight import straight_line

TITLE = 'Points received of each cloud (Figure 11)'

EXPLANATION = """
A LiDAR gives ten clouds of 23 040 points a second. Thinned by a voxel grid of 0.1 m they cross the link: by this
package in datagrams of 80 points, each of use alone, as in the deliverable; and, for comparison, the same thinned
clouds as whole messages over ROS' TCP and UDP transports; all is sent (`adapt` is off). The delay is 2 ms, as in the
deliverable, and 50 ms. The deliverable: points fall linearly with loss; whole clouds over UDP almost never come from
3 % of loss on; over TCP they come with 5 Hz at 10 % and almost never at 20 %, with a delay of 2 ms.

`packed` is what this package does by default: a third of the bytes, in fewer datagrams, so that at 90 % loss now and
then none of a cloud's comes.
"""

LOSSES = 0, 1, 2, 5, 10, 20, 50, 90
DELAYS = 2, 50
QUICK_LOSSES, QUICK_DELAYS = (0, 10, 90), (50,)

OURS, PACKED, TCP, UDP = 'smokebot_udp', 'smokebot_udp, packed', 'cloud over TCPROS', 'cloud over UDPROS'
BOTH = Way('velodyne_points', [['operator/lidar/points', 'cloud', 'TCPROS'],
                               ['operator/lidar_packed/points', 'cloud', 'TCPROS']])
WAYS = {(OURS, PACKED): BOTH,
        (TCP,): Way('whole/cloud', [['whole/cloud', 'cloud', 'TCPROS']]),
        (UDP,): Way('whole/cloud', [['whole/cloud', 'cloud', 'UDPROS']])}
"""{names of what is subscribed: Way}"""

STYLES = {OURS: 'o-', PACKED: 'o:', TCP: 's-', UDP: 's-'}


def run(run):
    losses, delays, seconds = (QUICK_LOSSES, QUICK_DELAYS, 1.0) if run.quick else (LOSSES, DELAYS, 4.0)
    rows = []
    with Crossing(run) as crossing:
        for delay, names, loss in run.steps(product(delays, WAYS, losses), say=str):
            heard, state = crossing.measure(WAYS[names], seconds, loss / 100, delay / 1e3)
            for name, (topic, *_) in zip(names, WAYS[names].wanted):
                rows.append({'way': name, 'delay [ms]': delay, 'loss [%]': loss,
                             **summary([h for h in heard if h.topic == topic], seconds), **state})
            table.write(run.folder / 'points.csv', rows)


def plot(folder):
    rows = table.read(folder / 'points.csv')
    delays = sorted({row['delay [ms]'] for row in rows})
    figure, (left, *right) = drawing.canvas(6 + 3.2 * len(delays), 4.4, columns=1 + len(delays))
    ours = [row for row in rows if row['way'] == OURS and row['amount']]
    losses = sorted({row['loss [%]'] for row in ours})
    points = [statistics.mean(row['amount'] for row in ours if row['loss [%]'] == loss) for loss in losses]
    slope, start, fit = straight_line(losses, points)
    left.plot(losses, points, 'o', color=drawing.OURS, label='smokebot_udp, measured')
    left.plot(losses, [start + slope * loss for loss in losses], '-', color=drawing.OURS, linewidth=1,
              label='straight line, R² = %.4f' % fit)
    left.set(xlabel='packets lost [%]', ylabel='points', ylim=(0, 1.25 * max(points)), title='points of each cloud')
    left.legend(loc='upper right')
    for delay, axes in zip(delays, right):
        for name, style in STYLES.items():
            cells = [row for row in rows if (row['way'], row['delay [ms]']) == (name, delay)]
            axes.plot([row['loss [%]'] for row in cells], [row['rate [Hz]'] for row in cells], style, markersize=4,
                      color=drawing.WAYS.get(name, drawing.OURS), label=name)
        axes.set(xlabel='packets lost [%]', ylabel='clouds a second', ylim=(-0.3, RATE * 1.1),
                 title='delay %d ms each way' % delay)
    right[-1].legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    drawing.save(figure, folder / 'points.png')
    shown = sorted({row['loss [%]'] for row in rows})
    table_rows = []
    for name, delay in product(STYLES, delays):
        cells = [row for row in rows if (row['way'], row['delay [ms]']) == (name, delay)]
        table_rows.append([name, delay, *(row['rate [Hz]'] for row in cells)])
    return [Figure('points.png', 'Left: points of each cloud that came. Right: how many clouds came.'),
            Table('Clouds a second.', ['way', 'delay [ms]', *('%d %%' % loss for loss in shown)], table_rows)]


again(__name__, plot)
