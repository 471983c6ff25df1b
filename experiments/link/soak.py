# SPDX-License-Identifier: BSD-3-Clause
"""Half an hour of random faults: what comes back by itself, how soon, and whether anything is left behind."""
import itertools
import math
import pathlib
import time
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Union

from evaluation import machine, soak
from evaluation.soak_run import OURS, Round, Sample, Soak

from .. import drawing, table
from ..runner import Figure, Run, Skipped, Table

TITLE = 'Never stuck: faults in any order'

EXPLANATION = """
Round after round a random fault hits the robot, its master, the link or an operator, at 5 % packet loss. Nodes are
killed without warning (`kill -9`) and started again. When the robot reboots, its master and all its nodes end together,
while the operator's side goes on. The link is cut for up to 30 s. The operator's machine gets another address: the
machines know each other by host names. A second operator comes, and ends in order. The robot's clock is stepped by up
to an hour either way. A stranger calls the nodes: connections in others' names, forged notifications. All kinds of
faults come equally often, in an order drawn from the seed. After a third of the time only those come that both nodes
live through, since the growth of their memory is seen in long lives.

A stream is fresh when the operator shows a message that is stamped after the end of the fault. The wait counts from the
moment at which the last part that was started again has registered at the master, else from the end of the fault, until
every stream is fresh. After each round each node may have one thread and one file descriptor more than after the best
round before with the same nodes, at most: a leak adds up. Connections that clients keep open do not count, nor three to
the master or ended by the other side.
"""

MINUTES, QUICK_MINUTES = 30.0, 2.0
QUICK_LONGEST = 3.0
"""Limit of the duration of a fault in a quick run [s]."""

SETTLED = 1 / 3
"""From this share of the soak on the slope of the memory counts, and both nodes live on: see GENTLE."""

WARM_UP = 600.0
"""The memory of a process grows for this time after its start: buffers, threads' arenas, caches, the map [s]."""

MAX_SLOPE = 0.2
"""Goal of the resident memory's growth [MB/min]."""


def run(run: Run) -> None:
    """Write rounds.csv, waits.csv, resources.csv."""
    minutes = run.minutes or (QUICK_MINUTES if run.quick else MINUTES)
    longest = QUICK_LONGEST if run.quick else math.inf
    done: List[Round] = []
    begin = time.monotonic()
    settled, end = begin + SETTLED * 60 * minutes, begin + 60 * minutes
    faults = itertools.chain(
        itertools.takewhile(lambda _: time.monotonic() < settled, soak.faults(run.seed, longest)),
        itertools.takewhile(lambda _: time.monotonic() < end, soak.faults(run.seed, longest, soak.GENTLE)))
    try:
        running = Soak(run.folder, run.seed)
    except FileNotFoundError as error:
        raise Skipped(str(error)) from error
    with running:
        for fault in run.steps(faults, lambda fault: fault.kind):
            done.append(running.round(fault))
            write(run.folder, done, running.samples)


def write(folder: pathlib.Path, done: Sequence[Round], samples: Sequence[Sample]) -> None:
    """Write all rounds until now."""
    table.write(folder / 'rounds.csv', [{
        'round': i, 'at [s]': round(one.at, 1), 'fault': one.fault.kind, 'seconds': round(one.fault.seconds, 1),
        'step [s]': round(one.fault.step, 1),
        'registered [s]': None if one.registered is None else round(one.registered, 2),
        'wait [s]': None if one.wait is None else round(one.wait, 2), 'slowest': one.slowest, 'unequal': one.unequal,
        'died': ' '.join(one.died), 'load': round(one.load, 1)} for i, one in enumerate(done)])
    table.write(folder / 'waits.csv', [{
        'round': i, 'stream': stream, 'wait [s]': None if wait is None else round(wait, 2)}
        for i, one in enumerate(done) for stream, wait in one.waits.items()])
    table.write(folder / 'resources.csv', [{
        'at [s]': round(sample.at, 1), 'node': sample.node, 'process': sample.process,
        'threads': sample.usage.threads, 'descriptors': sample.usage.descriptors,
        'memory [MB]': round(sample.usage.memory, 3)} for sample in samples])


class Goal(NamedTuple):
    """A goal, and what was measured."""
    what: str
    goal: str
    measured: str
    met: bool


def slopes(resources: Sequence[table.Row]) -> Dict[str, Any]:
    """{node: (slope, standard error) [MB/min], None where too little was measured}; resources: rows of the file."""
    begin = SETTLED * max(row['at [s]'] for row in resources)
    found: Dict[str, Any] = {}
    for node in OURS:
        rows = [row for row in resources if row['node'] == node]
        found[node] = soak.memory_slope([row['at [s]'] for row in rows], [row['process'] for row in rows],
                                        [row['memory [MB]'] for row in rows], WARM_UP, begin)
    return found


def goals(folder: pathlib.Path) -> List[Goal]:
    """All goals of the last run."""
    rounds = table.read(folder / 'rounds.csv')
    found = []
    for kind, waits in soak.waits_by_kind((row['fault'], row['wait [s]']) for row in rounds).items():
        goal = soak.KINDS[kind]
        found.append(Goal(
            kind, 'median %g s, worst %g s' % (goal.median, goal.worst),
            'median %.2f s, worst %.2f s of %d' % (waits.median, waits.worst, waits.rounds),
            waits.median <= goal.median and waits.worst <= goal.worst))
    unequal = sum(bool(row['unequal']) for row in rounds)
    found.append(Goal('threads and descriptors', 'at most one more than ever', 'not in %d of %d rounds' % (
        unequal, len(rounds)), not unequal))
    died = [row['died'] for row in rounds if row['died']]
    found.append(Goal('nodes that ended by themselves', 'none', ', '.join(died) or 'none', not died))
    for node, slope in slopes(table.read(folder / 'resources.csv')).items():
        if slope is not None:
            found.append(Goal('memory of %s' % node, 'at most %g MB/min' % MAX_SLOPE,
                              '%.2f ± %.2f MB/min' % slope, slope[0] <= MAX_SLOPE))
    return found


def missed(folder: pathlib.Path) -> List[str]:
    """The goals that the last run missed."""
    return ['%s: %s' % (goal.what, goal.measured) for goal in goals(folder) if not goal.met]


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The waits by kind of fault, the memory over time, and the goals."""
    rounds, resources = (table.read(folder / name) for name in ('rounds.csv', 'resources.csv'))
    figure, (above, below) = drawing.canvas(9, 7.5, rows=2)
    kinds = list(soak.waits_by_kind((row['fault'], row['wait [s]']) for row in rounds))
    for height, kind in enumerate(kinds):
        waits = [row['wait [s]'] for row in rounds if row['fault'] == kind]
        above.plot([wait for wait in waits if wait is not None], [height] * sum(wait is not None for wait in waits),
                   'o', color=drawing.OURS, alpha=0.5)
        above.plot([soak.KINDS[kind].worst], [height], '|', color='0.3', markersize=16)
        never = sum(wait is None for wait in waits)
        if never:
            above.text(soak.KINDS[kind].worst, height + 0.35, ' %d never' % never, va='center', color=drawing.OURS)
    longest = max((row['wait [s]'] or 0.0 for row in rounds), default=0.0)
    above.set(xlabel='[s] until every stream is fresh; the stroke is the goal', xlim=(0, max(12.0, 1.05 * longest)),
              ylim=(-0.6, len(kinds) - 0.4))
    above.set_yticks(range(len(kinds)))
    above.set_yticklabels(kinds)
    for node, colour in zip(OURS, ('#1f77b4', drawing.OURS, '#2ca02c')):
        rows = [row for row in resources if row['node'] == node]
        label: Optional[str] = node
        for _, life in itertools.groupby(rows, lambda row: row['process']):
            samples = list(life)
            below.plot([row['at [s]'] / 60 for row in samples], [row['memory [MB]'] for row in samples], color=colour,
                       label=label, linewidth=1)
            label = None
    below.set(xlabel='[min]', ylabel='resident memory [MB]', ylim=(0, None))
    drawing.legend_right(below)
    drawing.save(figure, folder / 'soak.png')
    loads = [row['load'] for row in rounds]
    return [
        Figure('soak.png', 'Above: each dot is one round. Below: the resident memory of the nodes; a line ends where '
               'its process was killed. Load of the machine (%s): %.1f to %.1f.' % (
                   machine.describe(), min(loads), max(loads))),
        goals_table(folder),
        Table('Rounds in which something was missed.', ['at [min]', 'fault', 'wait [s]', 'slowest', 'unequal', 'died'],
              [[row['at [s]'] / 60, row['fault'], 'never' if row['wait [s]'] is None else row['wait [s]'],
                row['slowest'], row['unequal'], row['died']] for row in rounds
               if row['wait [s]'] is None or row['wait [s]'] > soak.KINDS[row['fault']].worst or row['unequal'] or
               row['died']])]


def goals_table(folder: pathlib.Path) -> Table:
    """All goals, and whether they are met."""
    found, rounds = goals(folder), table.read(folder / 'rounds.csv')
    verdict = ('All goals are met' if all(goal.met for goal in found) else
               '%d of %d goals are missed' % (sum(not goal.met for goal in found), len(found)))
    return Table('**%s** in %d rounds. The memory\'s slope is one for all lives of a node, without the first %g s of '
                 'each, from a third of the soak on.' % (verdict, len(rounds), WARM_UP),
                 ['what', 'goal', 'measured', 'met'],
                 [[goal.what, goal.goal, goal.measured, 'yes' if goal.met else '**no**'] for goal in found])


DOC_TABLES = {'goals': goals_table}
