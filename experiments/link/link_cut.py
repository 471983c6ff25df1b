# SPDX-License-Identifier: BSD-3-Clause
"""A scenario of our own: the link is cut for half a minute."""
import pathlib
from typing import List, Union

import numpy as np

from .. import table
from ..runner import Figure, Run, Table
from . import traces

TITLE = 'A link that is cut for 30 s'

EXPLANATION = """
For 30 s nothing crosses, as when a robot drives through a shielded door; before and after that the link is good (20 ms,
2 % loss). What matters is how soon after the cut the operator sees the present again. TCP doubles the time between its
attempts again and again. Depending on chance it continues at once, or as long after the cut as the cut lasted, and it
first delivers what it has kept: images from before the cut.
"""

TRACE = """
seed: 1
course:
  - {at: 0, delay: 0.02, rate: 54e6, loss: 0.02}
  - {at: 10, loss: 1.0}
  - {at: 40, loss: 0.02}
"""

SECONDS = 65.0
QUICK_SPEED = 13.0

FRESH = 1.0
"""A younger image shows the present [s]."""


def run(run: Run) -> None:
    """Follow the trace with each method."""
    traces.run(run, TRACE, SECONDS, QUICK_SPEED)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure over time, and a table of what follows the cut."""
    traces.draw(folder, 'link_cut.png')
    return [Figure('link_cut.png', traces.CAPTION), after_table(folder)]


def after_table(folder: pathlib.Path) -> Table:
    """How soon the present is seen again."""
    ended = table.read(folder / 'link.csv')[2]['at [s]']
    rows = []
    for method, images in traces.images(folder).items():
        after = images.arrivals >= ended
        fresh = images.arrivals - images.stamps < FRESH
        waits = ['%.2f' % (images.arrivals[which].min() - ended) if which.any() else 'never'
                 for which in (after, after & fresh)]
        rows.append([method, *waits, int(np.count_nonzero(after & ~fresh))])
    return Table('After the cut:', ['method', 'first image after [s]', 'first one younger than %g s after [s]' % FRESH,
                                    'older images that arrived'], rows)


DOC_TABLES = {'after': after_table}
