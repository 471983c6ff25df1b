# SPDX-License-Identifier: BSD-3-Clause
"""A scenario of our own: the robot drives out of range and back."""
import pathlib
from typing import List, Union

import numpy as np

from evaluation.sensor_source import RATE

from .. import table
from ..runner import Figure, Run, Table
from . import traces

TITLE = 'Driving out of range and back'

EXPLANATION = """
The robot drives away behind two repeaters: the delay grows, losses come in ever longer bursts, and the rate falls
until almost nothing crosses; then it returns the same way. The ten images per second of a camera, 640 x 480 in grey,
cross by this package in its default coding and interleaved, by JPEG over TCPROS and by JPEG over UDPROS, one after the
other over the same trace. The third row matters most: how old is what the operator looks at? An image that is seconds
old shows where the robot was.

From 24 Mbit/s down the link carries less than the 25 Mbit/s of the raw images. Interleaved, this package sends the part
of each that fits, and by default it compresses them: its rate follows the reports of the operator's side. A JPEG needs
1.2 Mbit/s, all of it.
"""

TRACE = """
seed: 1
course:
  - {at: 0, delay: 0.002, rate: 54e6}
  - {at: 8, delay: 0.01, rate: 24e6, loss: 0.05, burst: 2}      # behind the first repeater
  - {at: 16, delay: 0.03, rate: 12e6, loss: 0.15, burst: 3}      # behind the second
  - {at: 24, delay: 0.05, rate: 6e6, loss: 0.4, burst: 5}
  - {at: 32, delay: 0.05, rate: 2e6, loss: 0.9, burst: 20}       # almost out of range
  - {at: 40, delay: 0.05, rate: 6e6, loss: 0.4, burst: 5}
  - {at: 48, delay: 0.03, rate: 12e6, loss: 0.15, burst: 3}
  - {at: 56, delay: 0.01, rate: 24e6, loss: 0.05, burst: 2}
  - {at: 64, delay: 0.002, rate: 54e6, loss: 0, burst: 0}
"""

SECONDS = 76.0
QUICK_SPEED = 16.0


def run(run: Run) -> None:
    """Follow the trace with each method."""
    traces.run(run, TRACE, SECONDS, QUICK_SPEED)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure over time, and a table of ages."""
    traces.draw(folder, 'out_of_range.png')
    return [Figure('out_of_range.png', traces.CAPTION), ages_table(folder)]


def ages_table(folder: pathlib.Path) -> Table:
    """How many images arrive, and how old the newest one is."""
    found = traces.images(folder)
    end = max(images.arrivals.max() for images in found.values())
    times = np.arange(traces.WINDOW, end, traces.STEP)
    rows = []
    for method, images in found.items():
        ages = traces.shown(images.stamps, images.arrivals, times)[1]
        rows.append([method, len(images.stamps),
                     *('%.2f' % age for age in np.asarray(np.nanpercentile(ages, (50, 90, 100))))])
    sent = RATE * table.read(folder / 'link.csv')[-1]['at [s]']
    return Table('What the operator looks at, over the whole trace:',
                 ['method', 'images, of %.0f' % sent, 'age, median [s]', 'age, p90 [s]', 'age, worst [s]'],
                 rows)


DOC_TABLES = {'ages': ages_table}
