# SPDX-License-Identifier: BSD-3-Clause
"""Runs experiments, each into a folder of its own.

An experiment is a module of this package with

    TITLE          one line
    EXPLANATION    Markdown: what was done, what the figures show, for a reader who does not know the paper
    run(run)       measures; writes CSV files (table.write) or arrays into run.folder. Raises Skipped, with a reason,
                   where it cannot be done
    plot(folder)   reads these files, and writes the figures beside them as PNG:
                   [Figure or Table, ...], in the report's order

and ends with `again(__name__, plot)`, so that `python3 -m experiments.NAME` draws anew what was measured before.
`run.json` in its folder says how it went, and has all that report.py tells of it.
"""
import datetime
import json
import pathlib
import shutil
import time
import traceback
from dataclasses import asdict, dataclass
from typing import List, Sequence

from tqdm import tqdm

from smokebot_udp.link_lab.lab import LabError

TOP = pathlib.Path(__file__).resolve().parent.parent
RESULTS = TOP / 'results' / 'experiments'
TOLD = 'run.json'
DONE = 'done'


class Skipped(Exception):
    """An experiment cannot be done here; the message says why."""


@dataclass
class Figure:
    """A picture of the report."""
    name: str
    """Of the PNG file in the experiment's folder."""
    caption: str
    """Markdown: what is to be seen on it."""


@dataclass
class Table:
    """A table of the report."""
    caption: str
    head: Sequence[str]
    rows: List[Sequence]
    """Texts or numbers."""


class Run:
    """What an experiment knows of its run.

    :param folder: pathlib.Path, which is there, and where the CSV files go
    :param quick: whether to be done in seconds rather than minutes
    :param seed: of all that is random
    """

    def __init__(self, folder, quick, seed):
        self.folder, self.quick, self.seed = folder, quick, seed

    def steps(self, items, say=None):
        """The items, one after the other, while a progress bar tells how far it is; say(item) tells what is done."""
        with tqdm(list(items), desc=self.folder.name, leave=False, dynamic_ncols=True) as bar:
            for item in bar:
                bar.set_postfix_str(say(item) if say else '')
                yield item


def run_experiment(name, module, results, quick, seed):
    """Run one experiment and draw its figures, in its folder, which is made anew.

    :return: DONE, or 'skipped: ...' or 'failed: ...' with the reason
    """
    folder = results / name
    shutil.rmtree(str(folder), ignore_errors=True)
    folder.mkdir(parents=True)
    begun, end, items = time.monotonic(), DONE, []
    try:
        module.run(Run(folder, quick, seed))
        items = module.plot(folder)
    except (Skipped, LabError) as reason:
        end = 'skipped: %s' % reason
    except Exception as error:      # the others are to be run all the same
        traceback.print_exc()
        end = 'failed: %r' % error
    _tell(folder, {
        'end': end, 'quick': quick, 'seed': seed, 'seconds': round(time.monotonic() - begun, 1),
        'date': datetime.datetime.now(datetime.timezone.utc).strftime('%Y-%m-%d %H:%M UTC'),
        'title': module.TITLE, 'explanation': module.EXPLANATION.strip()}, items)
    return end


def told_of(folder):
    """What `run.json` tells: a dict, whose `items` are Figures and Tables; None where nothing ran to its end."""
    path = folder / TOLD
    if not path.exists():
        return None
    told = json.loads(path.read_text())
    told['items'] = [(Table if 'rows' in item else Figure)(**item) for item in told['items']]
    return told


def _tell(folder, told, items):
    told = {**told, 'items': [asdict(item) for item in items]}
    (folder / TOLD).write_text(json.dumps(told, indent=1, default=lambda number: number.item()))    # numpy's


def redraw(plot, folder):
    """Draw anew what was measured before: the figures' paths, or None where nothing was."""
    told = told_of(folder)
    if told is None or told['end'] != DONE:
        return None
    items = plot(folder)
    _tell(folder, told, items)
    return [folder / item.name for item in items if isinstance(item, Figure)]


def again(name, plot):
    """Where the experiment's module is run as a program: draw anew what was measured before."""
    if name == '__main__':
        import __main__
        folder = RESULTS / pathlib.Path(__main__.__file__).stem
        paths = redraw(plot, folder)
        if paths is None:
            raise SystemExit('nothing was measured yet: ./smokebot experiments %s' % folder.name)
        print(*paths, sep='\n')
