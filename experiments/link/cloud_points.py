# SPDX-License-Identifier: BSD-3-Clause
"""Figure 11: the points that are received of a cloud."""
import pathlib
from itertools import product
from typing import Any, Dict, List, Sequence, Tuple, Union

import numpy as np

from evaluation.linear_fit import linear_fit
from evaluation.link_run import LinkRun, Method, summary
from evaluation.sensor_source import RATE

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Points received of each cloud (Figure 11)'

EXPLANATION = """
A LiDAR delivers ten clouds of 23 040 points per second. Decimated by a voxel grid of 0.1 m they cross the link: by this
package in datagrams of 80 points, each useful without the others, as in the deliverable; and, for comparison, as single
messages over ROS' TCP and UDP transports. All is sent (`adapt` is off). The delay is 2 ms, as in the deliverable, and
50 ms. The deliverable: points fall linearly with loss; whole clouds over UDP almost never arrive from 3 % loss on; over
TCP they arrive at 5 Hz at 10 % and almost never at 20 %, with a delay of 2 ms.

`sorted` is the default of streams.yaml: a fifth of the bytes, in far fewer datagrams, so that at 90 % loss often no
datagram of a cloud arrives.
"""

LOSSES = 0, 1, 2, 5, 10, 20, 50, 90
"""[%]"""

DELAYS = 2, 50
"""Each way [ms]."""

SECONDS = 3.0
QUICK_LOSSES, QUICK_DELAYS, QUICK_SECONDS = (0, 10, 90), (50,), 1.0

OURS, SORTED, TCP, UDP = 'smokebot_udp', 'smokebot_udp, sorted', 'cloud over TCPROS', 'cloud over UDPROS'
METHODS: Dict[Tuple[str, ...], Method] = {
    (OURS, SORTED): Method('velodyne_points', [['operator/lidar/points', 'cloud', 'TCPROS'],
                                               ['operator/lidar_sorted/points', 'cloud', 'TCPROS']]),
    (TCP,): Method('whole/cloud', [['whole/cloud', 'cloud', 'TCPROS']]),
    (UDP,): Method('whole/cloud', [['whole/cloud', 'cloud', 'UDPROS']])}
"""{names of the subscriptions: Method}"""

STYLES = {OURS: 'o-', SORTED: 'o:', TCP: 's-', UDP: 's-'}


def run(run: Run) -> None:
    """Write points.csv."""
    losses: Sequence[int] = QUICK_LOSSES if run.quick else LOSSES
    delays: Sequence[int] = QUICK_DELAYS if run.quick else DELAYS
    seconds = QUICK_SECONDS if run.quick else SECONDS
    rows = []
    with LinkRun(run.seed, run.folder / 'nodes.log', run.quick) as link:
        for delay, names, loss in run.steps(product(delays, METHODS, losses), str):
            heard, state = link.measure(METHODS[names], seconds, loss / 100, delay / 1e3)
            for name, (topic, *_) in zip(names, METHODS[names].subscriptions):
                rows.append({'way': name, 'delay [ms]': delay, 'loss [%]': loss,
                             **summary([message for message in heard if message.topic == topic], seconds), **state})
            table.write(run.folder / 'points.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure and a table over loss."""
    rows = table.read(folder / 'points.csv')
    delays = sorted({row['delay [ms]'] for row in rows})
    figure, (left, *right) = drawing.canvas(6 + 3.2 * len(delays), 4.4, columns=1 + len(delays))
    draw_points(left, [row for row in rows if row['way'] == OURS and row['amount']])
    for name, style in STYLES.items():
        for delay, axes in zip(delays, right):
            cells = [row for row in rows if (row['way'], row['delay [ms]']) == (name, delay)]
            rates = [row['rate [Hz]'] for row in cells]
            axes.plot([row['loss [%]'] for row in cells], rates, style, markersize=4,
                      color=drawing.COLOURS.get(name, drawing.OURS), label=name)
            axes.set(xlabel='packets lost [%]', ylabel='clouds per second', ylim=(-0.3, RATE * 1.1),
                     title='delay %d ms each way' % delay)
    drawing.legend_right(right[-1])
    drawing.save(figure, folder / 'points.png')
    return [Figure('points.png', 'Left: received points per cloud. Right: clouds that arrive.'),
            rates_table(folder), points_table(folder)]


def rates_table(folder: pathlib.Path) -> Table:
    """Clouds per second over loss."""
    rows, losses, found = cells_of(folder, 'rate [Hz]')
    return Table('Clouds per second, by the packet loss; the delay is one way:',
                 ['method', 'delay [ms]', *('%d %%' % loss for loss in losses)],
                 [[name, delay, *('%.3g' % found[name, delay, loss] for loss in losses)] for name, delay in rows])


def points_table(folder: pathlib.Path) -> Table:
    """Points of the clouds that arrive."""
    rows, losses, found = cells_of(folder, 'amount')
    means = {name: [float(np.mean([found[name, delay, loss] or 0.0 for way, delay in rows if way == name]))
                    for loss in losses] for name in (OURS, SORTED)}
    return Table('Points of the clouds that arrive, mean. Over the loss the points of *%s* lie on a straight line with '
                 'R² = %.4f.' % (OURS, linear_fit(losses, means[OURS])[2]),
                 ['method', *('%d %%' % loss for loss in losses)],
                 [[name, *('%.0f' % value for value in values)] for name, values in means.items()])


def cells_of(folder: pathlib.Path,
             column: str) -> Tuple[List[Tuple[str, int]], List[int], Dict[Tuple[str, int, int], Any]]:
    """(method and delay of each row of a table, losses, {(method, delay, loss): the column})"""
    rows = table.read(folder / 'points.csv')
    delays, losses = (sorted({row[key] for row in rows}) for key in ('delay [ms]', 'loss [%]'))
    return (list(product(STYLES, delays)), losses,
            {(row['way'], row['delay [ms]'], row['loss [%]']): row[column] for row in rows})


DOC_TABLES = {'rates': rates_table, 'points': points_table}


def draw_points(axes: Any, rows: Sequence[table.Row]) -> None:
    """Received points per cloud over loss, and the line through them."""
    losses = sorted({row['loss [%]'] for row in rows})
    points = [float(np.mean([row['amount'] for row in rows if row['loss [%]'] == loss])) for loss in losses]
    slope, intercept, fit = linear_fit(losses, points)
    axes.plot(losses, points, 'o', color=drawing.OURS, label='smokebot_udp, measured')
    axes.plot(losses, [intercept + slope * loss for loss in losses], '-', color=drawing.OURS, linewidth=1,
              label='straight line, R² = %.4f' % fit)
    axes.set(xlabel='packets lost [%]', ylabel='points', ylim=(0, 1.25 * max(points)), title='points of each cloud')
    axes.legend(loc='upper right')
