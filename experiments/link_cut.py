# SPDX-License-Identifier: BSD-3-Clause
"""A scenario of our own: the link is cut for half a minute."""
import numpy as np

from . import scenario, table
from .runner import Figure, Table, again

TITLE = 'A link that is cut for 30 s'

EXPLANATION = """
For 30 s nothing crosses at all, as where a robot drives through a shielded door; before and after that the link is good
(20 ms, 2 % of loss). What matters is how soon after the cut the operator sees the present again. TCP waits ever longer
between its attempts, each time twice as long: it goes on somewhere between at once and as late again as the cut was
long, as chance has it, and brings first what it kept: pictures from before the cut.
"""

COURSE = """
seed: 1
course:
  - {at: 0, delay: 0.02, rate: 54e6, loss: 0.02}
  - {at: 10, loss: 1.0}
  - {at: 40, loss: 0.02}
"""

SECONDS = 80.0
QUICK_HASTE = 16.0

FRESH = 1.0
"""What is younger shows the present [s]."""


def run(run):
    scenario.run(run, COURSE, SECONDS, QUICK_HASTE)


def plot(folder):
    scenario.draw(folder, 'link_cut.png')
    ended = table.read(folder / 'link.csv')[2]['at [s]']
    rows = []
    for way, (stamps, arrivals, _) in scenario.messages(folder).items():
        after = arrivals >= ended
        fresh = arrivals[after & (arrivals - stamps < FRESH)]
        stale = np.count_nonzero(after & (arrivals - stamps >= FRESH))
        waited = [float(times.min() - ended) if len(times) else 'never' for times in (arrivals[after], fresh)]
        rows.append([way, *waited, int(stale)])
    return [Figure('link_cut.png', scenario.CAPTION),
            Table('After the cut.', ['way', 'first picture after [s]', 'first one younger than %g s after [s]' % FRESH,
                                     'older ones that came'], rows)]


again(__name__, plot)
