# SPDX-License-Identifier: BSD-3-Clause
"""A scenario of our own: the robot drives out of range, and comes back."""
import numpy as np

from . import scenario
from .runner import Figure, Table, again

TITLE = 'Driving out of range and back'

EXPLANATION = """
The robot drives away behind two repeaters: the delay grows, packets are lost in ever longer bursts, and the rate falls
until almost nothing crosses; then it comes back the same way. A camera's ten pictures a second, 640 x 480 grey ones,
cross by this package, by JPEG over TCPROS and by JPEG over UDPROS, one after the other through the same course. The
third row counts: how old is what the operator looks at? A picture that is seconds old shows where the robot was.

From 24 Mbit/s down the link carries less than the pictures' 25 Mbit/s. This package sends of each what fits: the rate
follows what the operator's side reports to have arrived. A JPEG needs 1.2 Mbit/s, all of it.
"""

COURSE = """
seed: 1
course:
  - {at: 0, delay: 0.002, rate: 54e6}
  - {at: 10, delay: 0.01, rate: 24e6, loss: 0.05, burst: 2}      # behind the first repeater
  - {at: 20, delay: 0.03, rate: 12e6, loss: 0.15, burst: 3}      # behind the second
  - {at: 30, delay: 0.05, rate: 6e6, loss: 0.4, burst: 5}
  - {at: 40, delay: 0.05, rate: 2e6, loss: 0.9, burst: 20}       # out of range, almost
  - {at: 50, delay: 0.05, rate: 6e6, loss: 0.4, burst: 5}
  - {at: 60, delay: 0.03, rate: 12e6, loss: 0.15, burst: 3}
  - {at: 70, delay: 0.01, rate: 24e6, loss: 0.05, burst: 2}
  - {at: 80, delay: 0.002, rate: 54e6, loss: 0, burst: 0}
"""

SECONDS = 95.0
QUICK_HASTE = 20.0


def run(run):
    scenario.run(run, COURSE, SECONDS, QUICK_HASTE)


def plot(folder):
    scenario.draw(folder, 'out_of_range.png')
    found = scenario.messages(folder)
    end = max(arrivals.max() for _, arrivals, _ in found.values() if len(arrivals))
    times = np.arange(scenario.WINDOW, end, scenario.STEP)
    rows = []
    for way, (stamps, arrivals, _) in found.items():
        ages = scenario.shown(stamps, arrivals, times)[1]
        rows.append([way, len(stamps), *(float(np.nanpercentile(ages, p)) for p in (50, 90, 100))])
    return [Figure('out_of_range.png', scenario.CAPTION),
            Table('What the operator looks at, over the whole course.',
                  ['way', 'pictures', 'age, median [s]', 'age, p90 [s]', 'age, worst [s]'], rows)]


again(__name__, plot)
