# SPDX-License-Identifier: BSD-3-Clause
"""Runs experiments, each in a results folder of its own.

An experiment is a module with

    TITLE          one line
    EXPLANATION    Markdown, for readers who do not know the paper: what is done, and what the figures show
    run(run)       measures, and writes CSV files (table.write) or arrays into run.folder; raises Skipped with a reason
                   where it cannot be done
    plot(folder)   reads these files, and writes figures beside them as PNG; returns [Figure or Table, ...] in the
                   report's order
    missed(folder) optional: the goals that these files miss, as texts
    DOC_TABLES     optional: {name: function of a folder that makes a Table of these files}, for doc/, see doc_tables

`./smokebot experiments NAME --draw` redraws the figures without measuring. `run.json` in the folder holds the outcome,
the state of the code and of the machine, and everything else that report.py needs.
"""
import datetime
import json
import os
import pathlib
import shutil
import time
import traceback
from dataclasses import asdict, dataclass
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, TypeVar, Union

from tqdm import tqdm

from evaluation import TOP, checkout, machine
from smokebot_udp.link_lab.lab import LabError

RESULTS = TOP / 'results' / 'experiments'
SUMMARY = 'run.json'
DONE, MISSED = 'done', 'goals missed'

Item = TypeVar('Item')


class Skipped(Exception):
    """An experiment cannot be done here; the message says why."""


@dataclass
class Figure:
    """A figure of the report."""
    name: str
    """Name of the PNG file in the experiment's folder."""
    caption: str
    """Caption in Markdown."""


@dataclass
class Table:
    """A table of the report."""
    caption: str
    """Caption in Markdown."""
    head: Sequence[str]
    rows: Sequence[Sequence[Any]]
    """Texts, numbers or None."""

    def markdown(self) -> str:
        """The table without its caption."""
        rows = [self.head, ['---'] * len(self.head), *self.rows]
        return '\n'.join('| %s |' % ' | '.join(map(_cell, row)) for row in rows)


def _cell(value: Any) -> str:
    if value is None:
        return ''
    return '%.4g' % value if isinstance(value, float) else str(value)


Plot = Callable[[pathlib.Path], List[Union[Figure, Table]]]


class Run:
    """One run of an experiment.

    :param folder: for the results; it exists
    :param quick: whether to take seconds rather than minutes
    :param seed: of all random numbers
    :param minutes: how long to measure, where the experiment asks; None: as it likes
    """

    def __init__(self, folder: pathlib.Path, quick: bool, seed: int, minutes: Optional[float] = None) -> None:
        self.folder, self.quick, self.seed, self.minutes = folder, quick, seed, minutes

    def steps(self, items: Iterable[Item], describe: Optional[Callable[[Item], str]] = None) -> Iterator[Item]:
        """Iterate over the items behind a progress bar; describe(item): text beside the bar."""
        with tqdm(items, desc=self.folder.name, leave=False, dynamic_ncols=True) as bar:
            for item in bar:
                bar.set_postfix_str(describe(item) if describe else '')
                yield item


def run_experiment(name: str, module: Any, results: pathlib.Path, quick: bool, seed: int,
                   minutes: Optional[float] = None) -> str:
    """Run an experiment and draw its figures, in its folder, whose former content is deleted.

    :param module: see above
    :return: DONE, or 'goals missed: ...', 'skipped: ...' or 'failed: ...' with the reason
    """
    folder = results / name
    shutil.rmtree(str(folder), ignore_errors=True)
    folder.mkdir(parents=True)
    begun, load, outcome = time.monotonic(), _load(), DONE
    commit, dirty = checkout.state()
    items: List[Union[Figure, Table]] = []
    try:
        module.run(Run(folder, quick, seed, minutes))
        items = module.plot(folder)
        missed = module.missed(folder) if hasattr(module, 'missed') else []
        if missed:
            outcome = '%s: %s' % (MISSED, '; '.join(missed))
    except (Skipped, LabError) as reason:
        outcome = 'skipped: %s' % reason
    except Exception as error:      # the other experiments are run all the same
        traceback.print_exc()
        outcome = 'failed: %r' % error
    _write_summary(folder, {
        'end': outcome, 'quick': quick, 'seed': seed, 'seconds': round(time.monotonic() - begun, 1),
        'date': datetime.datetime.now(datetime.timezone.utc).strftime('%Y-%m-%d %H:%M UTC'),
        'commit': commit, 'dirty': dirty, 'machine': machine.describe(), 'load': [load, _load()],
        'title': module.TITLE, 'explanation': module.EXPLANATION.strip()}, items)
    return outcome


def _load() -> float:
    """The load of the machine over the last minute."""
    return round(os.getloadavg()[0], 1)


def read_summary(folder: pathlib.Path) -> Optional[Dict[str, Any]]:
    """The content of `run.json`, whose `items` are Figures and Tables; None: no run has come to its end."""
    path = folder / SUMMARY
    if not path.exists():
        return None
    summary: Dict[str, Any] = json.loads(path.read_text())
    summary['items'] = [(Table if 'rows' in item else Figure)(**item) for item in summary['items']]
    return summary


def has_results(summary: Mapping[str, Any]) -> bool:
    """Whether a run came to its end, met its goals or not."""
    return str(summary['end']).startswith((DONE, MISSED))


def _write_summary(folder: pathlib.Path, summary: Dict[str, Any], items: Sequence[Union[Figure, Table]]) -> None:
    content = {**summary, 'items': [asdict(item) for item in items]}
    (folder / SUMMARY).write_text(json.dumps(content, indent=1, default=lambda number: number.item()))    # numpy's


def redraw(plot: Plot, folder: pathlib.Path) -> Optional[List[pathlib.Path]]:
    """Draw the figures of the last results again: their paths; None: there are no results."""
    summary = read_summary(folder)
    if summary is None or not has_results(summary):
        return None
    items = plot(folder)
    _write_summary(folder, summary, items)
    return [folder / item.name for item in items if isinstance(item, Figure)]
