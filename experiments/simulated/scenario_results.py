# SPDX-License-Identifier: BSD-3-Clause
"""What scenarios.py measured: the table, and the goals that were missed."""
import pathlib
from typing import Dict, Iterator, List, Tuple

import numpy as np

from .. import table
from ..goals import Goal
from ..runner import Run, Table
from .scenarios import SCENARIOS, Scenario

SEEDS, QUICK_SEEDS = 5, 2
FILE = 'scenarios.csv'


def measure(run: Run) -> None:
    """Run all scenarios, and write scenarios.csv."""
    seeds = QUICK_SEEDS if run.quick else SEEDS
    rows = []
    for scenario, seed in run.steps([(one, run.seed + number) for one in SCENARIOS for number in range(seeds)],
                                    lambda step: '%s, %d' % (step[0].name, step[1])):
        rows += [{'scenario': scenario.name, 'seed': seed, 'quantity': quantity, 'value': value}
                 for quantity, value in scenario.run(seed).items()]
    table.write(run.folder / FILE, rows)


def results(folder: pathlib.Path) -> Table:
    """The table of all scenarios."""
    measured = _values(folder)
    rows = []
    for scenario, quantity, values in _quantities(measured):
        goals = [goal for goal in scenario.goals if goal.quantity == quantity]
        rows.append([scenario.name, quantity, ' '.join(map(str, goals)), '%.3g' % np.median(values),
                     '%.3g' % min(values), '%.3g' % max(values),
                     ('yes' if _met(goals, values) else '**no**') if goals else ''])
    seeds = max(len(values) for values in measured.values())
    return Table('Links on which congestion control is hard, %d runs each. A goal is met where all of them meet it: '
                 '%d of %d are.' % (seeds, sum(row[-1] == 'yes' for row in rows), sum(bool(row[-1]) for row in rows)),
                 ['link', 'quantity', 'goal', 'median', 'least', 'most', 'met'], rows)


MAIN = {'used [%]': '≥ 85', 'own loss [%]': '≤ 1', 'queue p95 [ms]': '≤ 60'}
"""{quantity with a column of its own: its usual goal}"""


def doc_results(folder: pathlib.Path) -> Table:
    """All scenarios, a row each, with the quantities that have goals."""
    cells: Dict[str, Dict[str, str]] = {}
    for scenario, quantity, values in _quantities(_values(folder)):
        goals = [goal for goal in scenario.goals if goal.quantity == quantity]
        if goals:
            text = '%.3g (%.3g to %.3g)' % (np.median(values), min(values), max(values))
            text = text if _met(goals, values) else '**%s**' % text
            if quantity not in MAIN:
                text = '%s: %s, %s' % (quantity, text, ' '.join(map(str, goals)))
            cells.setdefault(scenario.name, {})[quantity] = text
    rows = [[name, *(found.get(quantity) for quantity in MAIN),
             '; '.join(text for quantity, text in found.items() if quantity not in MAIN)]
            for name, found in cells.items()]
    met = [text for found in cells.values() for text in found.values() if '**' not in text]
    return Table('The median of %d runs, with the least and the most; a goal that one of them misses is bold: %d of %d '
                 'are met. Goals: %s.' % (
                     max(len(values) for values in _values(folder).values()), len(met),
                     sum(map(len, cells.values())), ', '.join('%s %s' % item for item in MAIN.items())),
                 ['link', *MAIN, 'others'], rows)


def missed(folder: pathlib.Path) -> List[str]:
    """The goals that were missed."""
    return ['%s: %s %.3g to %.3g, goal %s' % (scenario.name, quantity, min(values), max(values),
                                              ' '.join(str(goal) for goal in scenario.goals
                                                       if goal.quantity == quantity))
            for scenario, quantity, values in _quantities(_values(folder))
            if not _met([goal for goal in scenario.goals if goal.quantity == quantity], values)]


def _values(folder: pathlib.Path) -> Dict[Tuple[str, str], List[float]]:
    """{(scenario, quantity): values}"""
    found: Dict[Tuple[str, str], List[float]] = {}
    for row in table.read(folder / FILE):
        found.setdefault((row['scenario'], row['quantity']), []).append(row['value'])
    return found


def _quantities(measured: Dict[Tuple[str, str], List[float]]) -> Iterator[Tuple[Scenario, str, List[float]]]:
    known = {scenario.name: scenario for scenario in SCENARIOS}
    for (name, quantity), values in measured.items():
        if name in known:
            yield known[name], quantity, values


def _met(goals: List[Goal], values: List[float]) -> bool:
    return all(goal.met(value) for goal in goals for value in values)
