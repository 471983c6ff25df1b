# SPDX-License-Identifier: BSD-3-Clause
"""The tables, files and plots of live_cells.py."""
import pathlib
import re
from typing import Any, List, Mapping, Sequence, Tuple

import numpy as np
from matplotlib.figure import Figure

from . import csv_rows, live_goals
from .live_idle import COMPLETE
from .live_run import Outcome
from .live_score import SETTLED, Row, image_rows, link_rows

Columns = Sequence[Tuple[str, str]]
"""(name, format)"""

METHOD: Columns = [('method', '%s')]
COLUMNS: Columns = [
    *METHOD, ('image mean [dB]', '%.1f'), ('image 5 % [dB]', '%.1f'), ('image worst [dB]', '%.1f'),
    ('screen mean [dB]', '%.1f'), ('screen 5 % [dB]', '%.1f'), ('screen worst [dB]', '%.1f'), ('age p50 [s]', '%.3f'),
    ('age p95 [s]', '%.3f'), ('freeze [s]', '%.2f'), ('rate [Hz]', '%.1f'), ('used', '%.2f'),
    ('capacity known', '%.2f'), ('dropped', '%d')]
STEP_COLUMNS: Columns = [
    *METHOD, ('rate', '%g'), ('oldest [s]', '%.2f'), ('steady after [s]', '%.2f'), ('steady mean [dB]', '%.1f'),
    ('worst [dB]', '%.1f'), ('used', '%.2f'), ('capacity known', '%.2f'), ('dropped', '%d')]
IDLE_COLUMNS: Columns = [
    ('streams', '%s'), ('to operator at first [kB]', '%.1f'), ('to operator then [kbit/s]', '%.1f'),
    ('to robot at first [kB]', '%.1f'), ('to robot then [kbit/s]', '%.1f')]
IDLE = 'idle: what crosses beside the images of a camera, or without one; until %g s after the start, then' % COMPLETE


def slug(*words: str) -> str:
    """A folder's name."""
    return re.sub(r'[^A-Za-z0-9.]+', '_', ' '.join(words)).strip('_')


def line(row: Row, columns: Columns = COLUMNS) -> str:
    """A row as text."""
    return '%-24s' % row['cell'] + ''.join(
        '%9s' % ('-' if row[name] is None else form % row[name]) for name, form in columns)


def head(columns: Columns) -> List[str]:
    """Lines above a table: each name in several of them, its unit in the last one."""
    cells = [re.match(r'(.*?)(?: (\[.*\]))?$', name).groups('') for name, _ in columns]     # type: ignore[union-attr]
    stacks: List[List[str]] = []
    for words, unit in cells:
        stack: List[str] = []
        for word in words.split():
            if stack and len(stack[-1]) + len(word) < 8:
                stack[-1] += ' ' + word
            else:
                stack.append(word)
        stacks.append(stack + [unit] * bool(unit))
    height = max(map(len, stacks))
    return [(' ' * 24 + ''.join('%9s' % ([''] * (height - len(stack)) + stack)[i] for stack in stacks)).rstrip()
            for i in range(height)]


def text(results: Mapping[str, Any]) -> str:
    """All tables, and the goals that were missed."""
    lines = ['camera: %s, 752 x 480 grey, 10 Hz; watched from its third second on, without the first %g s'
             % (results['clip'], SETTLED)]
    for key, title, columns in (('rows', 'live', COLUMNS), ('steps', 'steps of the rate [Mbit/s]', STEP_COLUMNS),
                                ('idle', IDLE, IDLE_COLUMNS)):
        if results[key]:
            lines += ['', title, *head(columns)]
            for before, row in zip([None, *results[key]], results[key]):
                if before and before['cell'] != row['cell']:
                    lines.append('')
                lines.append(line(row, columns))
    misses = live_goals.missed(results)
    return '\n'.join([*lines, *(['', 'goals missed', *misses] if misses else [])])


def write(results: Mapping[str, Any], folder: pathlib.Path) -> None:
    """Write the tables: as text, and each as CSV."""
    (folder / 'table.txt').write_text(text(results) + '\n')
    for key in ('rows', 'steps', 'idle'):
        if results[key]:
            csv_rows.write(folder / (key + '.csv'), results[key])


def write_files(outcome: Outcome, folder: pathlib.Path) -> None:
    """Write a line for each image shown, and for each sample of the link."""
    for name, rows in (('images.csv', image_rows(outcome.screen, outcome.notes)),
                       ('link.csv', link_rows(outcome.samples, outcome.moments[0]))):
        if rows:
            csv_rows.write(folder / name, rows)


def plot(title: str, found: Mapping[str, Outcome], folder: pathlib.Path) -> None:
    """Draw the screen's PSNR over time, a panel for each method."""
    if not found:
        return
    figure = Figure(figsize=(12, 1.7 * len(found) + 0.8))
    panels: Any = figure.subplots(len(found), 1, sharex=True, sharey=True, squeeze=False)
    for axes, (method, outcome) in zip(panels[:, 0], found.items()):
        begun = outcome.moments[0]
        course = np.array(outcome.screen.course(begun, outcome.moments[-1]))
        images = np.array([(one.arrival, psnr) for one in outcome.screen.shown
                           for psnr in [outcome.screen.image_psnr(one)] if psnr is not None]).reshape(-1, 2)
        axes.plot(course[:, 0] - begun, course[:, 1], linewidth=0.8, label='screen')
        axes.plot(images[:, 0] - begun, images[:, 1], '.', markersize=3, label='each image')
        for moment in outcome.moments[1:-1]:
            axes.axvline(moment - begun, color='0.6', linewidth=0.8)
        axes.set_ylabel(method)
        axes.grid(alpha=0.3)
    panels[0, 0].set_title('%s: PSNR [dB]' % title)
    panels[0, 0].legend(loc='lower right', ncol=2, fontsize=8)
    panels[-1, 0].set_xlabel('time watched [s]')
    figure.tight_layout()
    figure.savefig(str(folder / (slug(title) + '.png')), dpi=90)
