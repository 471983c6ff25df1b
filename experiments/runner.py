# SPDX-License-Identifier: BSD-3-Clause
"""Runs experiments, each into a folder of its own, and writes the report of all that lie there.

An experiment is a module of this package with

    TITLE          one line
    EXPLANATION    Markdown: what was done, what the figures show, for a reader who does not know the paper
    run(run)       measures; writes CSV files into run.folder. Raises Skipped, with a reason, where it cannot be done
    plot(folder)   reads these CSV files, and writes the figures beside them as PNG:
                   [Figure or Table, ...], in the report's order

and ends with `again(__name__, plot)`, so that `python3 -m experiments.NAME` draws anew what was measured before.
"""
import datetime
import json
import pathlib
import shutil
import time
import traceback
from dataclasses import dataclass
from typing import List, Sequence

from tqdm import tqdm

from smokebot_udp.link_lab.lab import LabError

TOP = pathlib.Path(__file__).resolve().parent.parent
RESULTS = TOP / 'results' / 'experiments'


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
    """Run one experiment; `run.json` in its folder, which is made anew, says how it went.

    :return: 'done', or 'skipped: ...' or 'failed: ...' with the reason
    """
    folder = results / name
    shutil.rmtree(str(folder), ignore_errors=True)
    folder.mkdir(parents=True)
    begun, end = time.monotonic(), 'done'
    try:
        module.run(Run(folder, quick, seed))
    except (Skipped, LabError) as reason:
        end = 'skipped: %s' % reason
    except Exception as error:      # the others are to be run all the same
        traceback.print_exc()
        end = 'failed: %r' % error
    (folder / 'run.json').write_text(json.dumps({
        'end': end, 'quick': quick, 'seed': seed, 'seconds': round(time.monotonic() - begun, 1),
        'date': datetime.datetime.now(datetime.timezone.utc).strftime('%Y-%m-%d %H:%M UTC')}, indent=1))
    return end


def again(name, plot):
    """Where the experiment's module is run as a program: draw anew what was measured before."""
    if name == '__main__':
        import __main__
        folder = RESULTS / pathlib.Path(__main__.__file__).stem
        if not (folder / 'run.json').exists():
            raise SystemExit('nothing was measured yet: ./smokebot experiments %s' % folder.name)
        for item in plot(folder):
            if isinstance(item, Figure):
                print(folder / item.name)
