# SPDX-License-Identifier: BSD-3-Clause
"""How soon an operator that joins over heavy loss gets the streams that wait for its wishes: layers and tiles."""
import math
import pathlib
import statistics
from typing import Any, Dict, List, Sequence, Union

from evaluation.joins import HEAVY, HELLO, IMAGE, LAYERS, RELAYS, TILES, Joins
from evaluation.link_run import lab_state

from .. import table
from ..runner import Figure, Run, Table

TITLE = 'Joining over heavy loss'

EXPLANATION = """
Robot and operator have a master each, and a link with a key, which loses 80 % of the packets each way. The streams are
the package's `config/streams.yaml` and 40 relays. The operator's node is killed and started again for each join. The
time counts from when it logs that it has joined (its Joined event) until its diagnostics count the first datagram of a
layered image and the first one of the map's tiles, and until it publishes the camera's first image. Diagnostics come
once a second, so these times are up to a second too long. The first datagram of its handshake leaves before the join.
"""

JOINS, QUICK_JOINS = 20, 4
GOAL, SHARE = 5.0, 0.95
"""Layers and tiles are there so soon after this share of joins [s, 1]."""

AWAITED = {'layers': LAYERS, 'tiles': TILES, 'first image of the camera': IMAGE}
BOTH = 'layers and tiles'


def run(run: Run) -> None:
    """Write joins.csv."""
    rows: List[table.Row] = []
    with Joins(run.folder, run.seed) as joins:
        for number in run.steps(range(QUICK_JOINS if run.quick else JOINS), 'join {}'.format):
            rows.append({'join': number, **joins.join(), **lab_state(joins.stack.lab)})
            table.write(run.folder / 'joins.csv', rows)


def times(folder: pathlib.Path) -> Dict[str, List[float]]:
    """{what: [s] after each join, ascending; inf: never}"""
    def time(row: Any, name: str) -> float:
        return math.inf if row[name] is None else float(row[name])
    rows = table.read(folder / 'joins.csv')
    found = {what: [time(row, name) for row in rows] for what, name in AWAITED.items()}
    found[BOTH] = [max(pair) for pair in zip(found['layers'], found['tiles'])]
    found[BOTH + ', from its first datagram'] = [
        both - time(row, HELLO) for both, row in zip(found[BOTH], rows)]
    return {what: sorted(values) for what, values in found.items()}


def needed(values: Sequence[float]) -> float:
    """The time that SHARE of them keep; 20: the 19th [s]."""
    return values[math.ceil(SHARE * len(values)) - 1]


def missed(folder: pathlib.Path) -> List[str]:
    """Goals that were missed."""
    found = times(folder)[BOTH]
    return [] if needed(found) <= GOAL else ['%s: %d of %d joins within %g s' % (
        BOTH, sum(value <= GOAL for value in found), len(found), GOAL)]


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A table of the times."""
    return [times_table(folder)]


def times_table(folder: pathlib.Path) -> Table:
    """After the joins."""
    rows = [[what, len(values), *('%.1f' % time for time in (statistics.median(values), needed(values), values[-1])),
             '%d of %d' % (sum(value <= GOAL for value in values), len(values))]
            for what, values in times(folder).items()]
    return Table('Time after the join [s], %g %% of packets lost each way, %d relays beside the default streams. Goal: '
                 '%s within %g s after %g %% of joins.' % (100 * HEAVY['loss'], RELAYS, BOTH, GOAL, 100 * SHARE),
                 ['until', 'joins', 'median', '%g %%' % (100 * SHARE), 'worst', 'within %g s' % GOAL], rows)


DOC_TABLES = {'times': times_table}
