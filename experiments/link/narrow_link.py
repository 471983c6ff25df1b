# SPDX-License-Identifier: BSD-3-Clause
"""A camera over a narrow link, beside what a user would pick instead: the cells that doc/ shows."""
import json
import pathlib
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Union

from evaluation import live_goals, live_report
from evaluation.live_cells import IDEAL, Cells, measure
from evaluation.live_score import Row
from evaluation.shapers import parse

from ..runner import Figure, Run, Table

TITLE = 'A camera over a narrow link'

EXPLANATION = """
A camera of 752 x 480 pixels, grey, takes 10 images a second, over a link that the kernel's token bucket limits, and on
which UDP datagrams are lost at the operator. Both nodes have their default settings and a master each. The peers' bit
rate is set by hand to 0.85 of the link.
"""

NAMES = {'ours': 'this package', 'gst': 'H.264/RTP', 'fec': 'with 25 % ULPFEC', 'rtx': 'with retransmission',
         'srt': 'H.264 over SRT'}
"""{method: its column}, of those that are shown."""

METHODS = ('ours', IDEAL, *list(NAMES)[1:])
FULL = Cells([parse('tbf6')], [0.3, 1.0, 3.0], [0.0, 5.0, 20.0, 50.0], METHODS, 20.0, [3.0, 0.5, 3.0])
QUICK = FULL._replace(rates=[1.0], losses=[5.0], steps=[])

SHOWN = 'tbf6, 1 Mbit/s, 5 %'
"""The cell whose course is drawn."""


def run(run: Run) -> None:
    """Write results.json, and the files of `bench live`."""
    results = measure(QUICK if run.quick else FULL, run.folder, print)
    (run.folder / 'results.json').write_text(json.dumps(results, default=float))


def load(folder: pathlib.Path) -> Dict[str, Any]:
    """What was measured, see live_cells.measure."""
    found: Dict[str, Any] = json.loads((folder / 'results.json').read_text())
    return found


def missed(folder: pathlib.Path) -> List[str]:
    """Goals that were missed."""
    return live_goals.missed(load(folder))


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The tables, and the course of one cell."""
    name = live_report.slug(SHOWN) + '.png'
    return [*(make(folder) for make in DOC_TABLES.values()),
            Figure(name, 'The screen at 1 Mbit/s and 5 % loss: PSNR over time.')]


def images_table(folder: pathlib.Path) -> Table:
    """How sharp each image was that was shown."""
    def psnr(row: Row) -> str:
        return '%.1f (%.1f)' % (row['image mean [dB]'], row['image 5 % [dB]'])
    return _compared(folder, 'Each image shown, beside the one that the camera took: mean PSNR, and in brackets the '
                     '5th percentile [dB].', psnr)


def screen_table(folder: pathlib.Path) -> Table:
    """How well the screen showed what the camera saw."""
    return _compared(folder, 'The screen, beside what the camera sees at the moment: mean PSNR [dB]. *Ideal*: '
                     'layered images that have the whole rate, and are as old as those of this package were.',
                     lambda row: '%.1f' % row['screen mean [dB]'], {IDEAL: 'ideal'})


def ages_table(folder: pathlib.Path) -> Table:
    """How old the images were, and how long none came."""
    return _compared(folder, 'Age of images as they appear, median and 95th percentile [ms], and in brackets the '
                     'longest time without a new image [s].', lambda row: '%.0f, %.0f (%.2f)' % (
                         1e3 * row['age p50 [s]'], 1e3 * row['age p95 [s]'], row['freeze [s]']))


def link_table(folder: pathlib.Path) -> Table:
    """What this package made of the link."""
    rows = [row for row in load(folder)['rows'] if row['method'] == 'ours']
    return Table('This package: images a second, the part of the link that was used, and the part of the time in which '
                 'its capacity was known within 10 %.',
                 ['Mbit/s', 'lost [%]', 'images [Hz]', 'used', 'used below 42 dB', 'capacity known'],
                 [[*_link(row), *(_number(row[name], form) for name, form in (
                     ('rate [Hz]', '%.1f'), ('used', '%.2f'), ('used while blurred', '%.2f'),
                     ('capacity known', '%.2f')))] for row in rows])


def steps_table(folder: pathlib.Path) -> Table:
    """What happened as the rate changed."""
    return Table('The rate changes each 15 s, nothing is lost. *Steady*: five images in a row that are no more than '
                 '1.5 dB below the mean of the later half.',
                 ['method', 'Mbit/s', 'oldest image [s]', 'steady after [s]', 'mean then [dB]', 'worst image [dB]'],
                 [[NAMES[row['method']], '%g' % row['rate'], *(_number(row[name], form) for name, form in (
                     ('oldest [s]', '%.2f'), ('steady after [s]', '%.2f'), ('steady mean [dB]', '%.1f'),
                     ('worst [dB]', '%.1f')))] for row in load(folder)['steps']])


DOC_TABLES = {'images': images_table, 'screen': screen_table, 'ages': ages_table, 'link': link_table,
              'steps': steps_table}


def _compared(folder: pathlib.Path, caption: str, text_of: Callable[[Row], str],
              beside: Optional[Dict[str, str]] = None) -> Table:
    """A row for each link, a column for each method.

    :param text_of: f(row of a method) -> its cell
    :param beside: further columns
    """
    names = {**NAMES, **(beside or {})}
    cells: Dict[Tuple[str, str], Dict[str, str]] = {}
    for row in load(folder)['rows']:
        shown = row['image mean [dB]'] is not None and row['age p50 [s]'] is not None
        cells.setdefault(_link(row), {})[row['method']] = text_of(row) if shown else 'nothing'
    rows: List[Sequence[Any]] = [[*link, *(found.get(method, '') for method in names)] for link, found in cells.items()]
    return Table(caption, ['Mbit/s', 'lost [%]', *names.values()], rows)


def _link(row: Row) -> Tuple[str, str]:
    return '%g' % row['link [Mbit/s]'], '%g' % row['loss [%]']


def _number(value: Optional[float], form: str) -> Optional[str]:
    return None if value is None else form % value
