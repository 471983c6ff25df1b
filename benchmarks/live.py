# SPDX-License-Identifier: BSD-3-Clause
"""A camera over a narrow link, live: the nodes as shipped beside what a user would pick instead, on the same link.

Needs root. Both sides run in network namespaces; a kernel's shaper or the link lab limits the rate between them.
"""
import argparse
import itertools
import pathlib
import tempfile
from typing import Any, Callable, Dict, List, Optional, Sequence

from evaluation import TOP
from evaluation.live_clip import Clip
from evaluation.live_run import OURS, Cell, LiveRun
from evaluation.live_score import SETTLED, judged
from evaluation.gst_pipelines import WAYS
from evaluation.shapers import parse

RESULTS = TOP / 'results' / 'bench' / 'live'
METHODS = (*OURS, *WAYS)

COLUMNS = (('image mean [dB]', '%.1f'), ('image 5 % [dB]', '%.1f'), ('image worst [dB]', '%.1f'),
           ('screen mean [dB]', '%.1f'), ('screen 5 % [dB]', '%.1f'), ('screen worst [dB]', '%.1f'),
           ('age p50 [s]', '%.3f'), ('age p95 [s]', '%.3f'), ('freeze [s]', '%.2f'), ('rate [Hz]', '%.1f'),
           ('used', '%.2f'), ('capacity known', '%.2f'), ('dropped', '%d'))


def numbers(text: str) -> List[float]:
    """A list of numbers, as 0.3,1."""
    return [float(word) for word in text.split(',')]


def options(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(prog='./smokebot bench live', description=__doc__.split('\n')[0])
    parser.add_argument('--rates', type=numbers, default=[0.3, 1.0, 3.0, 10.0], help='[Mbit/s]')
    parser.add_argument('--losses', type=numbers, default=[0.0, 5.0, 20.0, 50.0], help='of UDP at the operator [%%]')
    parser.add_argument('--shapers', type=lambda text: [parse(word) for word in text.split(',')],
                        default=[parse(word) for word in ('tbf6', 'tbf32', 'lab')],
                        help='tbf1.5, tbf6, tbf32, htb, lab, wifi, each with /QUEUE [ms]')
    parser.add_argument('--methods', type=lambda text: text.split(','), default=['ours', 'layered', 'gst'],
                        help='of %s' % ', '.join(METHODS))
    parser.add_argument('--seconds', type=float, default=30.0, help='of each cell, after the first image')
    return parser.parse_args(arguments)


def run(log: Callable[[str], None], quick: bool = False, arguments: Sequence[str] = ()) -> Dict[str, Any]:
    """{'clip': name, 'rows': [{'cell', 'method', ...}, ...]}"""
    chosen = options(arguments)
    rows = []
    for shaper, rate, loss in itertools.product(chosen.shapers, chosen.rates, chosen.losses):
        cell = Cell(shaper, (1e6 * rate,), loss / 100, chosen.seconds)
        for method in chosen.methods:
            log('%s, %s' % (cell.name, method))
            row = measured(cell, method, log)
            if row:
                rows.append(row)
    return {'clip': Clip().name, 'rows': rows}


def measured(cell: Cell, method: str, log: Callable[[str], None]) -> Optional[Dict[str, Any]]:
    """A row of the table."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory() as folder, LiveRun(cell, method, pathlib.Path(folder)) as live:
            outcome = live.measure()
            row = judged(outcome.screen, outcome.told, outcome.begun + SETTLED, outcome.ended)
    except RuntimeError as error:
        log(str(error))
        return None
    row = {'cell': cell.name, 'method': method, **row}
    log(line(row))
    return row


def line(row: Dict[str, Any]) -> str:
    """A row as text."""
    return '%-26s %-8s' % (row['cell'], row['method']) + ''.join(
        '%8s' % ('-' if row[name] is None else form % row[name]) for name, form in COLUMNS)


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    head = [['', '', *(name.rsplit(' ', 1)[0] if '[' in name else name for name, _ in COLUMNS)]]
    words = [name.split(' ') + [''] * 3 for name in head[0][2:]]
    lines = ['%-26s %-8s' % ('', '') + ''.join('%8s' % one[i] for one in words) for i in range(2)]
    return '\n'.join(['camera: %s, 752 x 480 grey, 10 Hz; from %g s after the first image on; PSNR in dB, ages in s' % (
        results['clip'], SETTLED),
                      *lines, *(line(row) for row in results['rows'])])
