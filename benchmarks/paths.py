# SPDX-License-Identifier: BSD-3-Clause
"""Two links at once beside each of them alone, live, see evaluation/path_cells.py. Needs root.

doc/experiments.md, "Two links to one robot at once", has results.
"""
import argparse
import itertools
from typing import Any, Dict, List, Mapping, Sequence

from evaluation import TOP
from evaluation.live_clip import Clip
from evaluation.path_cells import CASES, Log, Row, measured

RESULTS = TOP / 'results' / 'bench' / 'paths'


def options(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(prog='./smokebot bench paths', description=(__doc__ or '').split('\n')[0])
    parser.add_argument('--cases', default='', help='only those whose name contains this')
    parser.add_argument('--seconds', type=float, default=20.0, help='of each case')
    parser.add_argument('--runs', type=int, default=1, help='of each case')
    return parser.parse_args(arguments)


def run(log: Log, quick: bool = False, arguments: Sequence[str] = ()) -> Dict[str, Any]:
    """{'clip': name, 'rows': [{'case', ...}, ...]}"""
    chosen = options(arguments)
    RESULTS.mkdir(parents=True, exist_ok=True)
    seconds = min(chosen.seconds, 10.0) if quick else chosen.seconds
    cases = [case for case in CASES if chosen.cases in case.name]
    rows: List[Row] = []
    for number, case in itertools.product(range(chosen.runs), cases):
        for row in measured(case, seconds, number, log, RESULTS):
            log(line(row))
            rows.append(row)
    return {'clip': Clip().name, 'rows': rows}


COLUMNS = ('screen mean [dB]', '%.1f'), ('screen 5 % [dB]', '%.1f'), ('image mean [dB]', '%.1f'), \
    ('image 5 % [dB]', '%.1f'), ('age p50 [s]', '%.3f'), ('age p95 [s]', '%.3f'), ('freeze [s]', '%.2f'), \
    ('rate [Hz]', '%.1f'), ('CPU', '%.2f')


def line(row: Mapping[str, Any]) -> str:
    """A row as text."""
    values = [form % row[name] if row[name] is not None else '-' for name, form in COLUMNS]
    return '| %s | %s | %s |' % (row['case'], ' | '.join(values), ', '.join('%.2f' % used for used in row['used']))


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    head = '| case | %s | used |' % ' | '.join(name for name, _ in COLUMNS)
    return '\n'.join([head, '|' + '---|' * (len(COLUMNS) + 2), *map(line, results['rows'])])
