# SPDX-License-Identifier: BSD-3-Clause
"""A camera over narrow links, live: the nodes as shipped beside what a user would pick instead, on the same link.

Needs root. Both sides run in network namespaces; a kernel's shaper or the link lab limits the rate between them. The
methods run one after the other.
"""
import itertools
import pathlib
import subprocess
import tempfile
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Type

from . import live_report
from .gst_pipelines import PACKAGES, WAYS
from .live_clip import Clip
from .live_idle import idle
from .live_run import OURS, Cell, LiveRun, Outcome
from .live_score import SETTLED, Row, judged, judged_step
from .own_masters import OwnMasters
from .shapers import Shaper
from .stack import Stack

IDEAL = 'ideal'
METHODS = (*OURS, IDEAL, *WAYS)
MASTERS: Dict[str, Type[Stack]] = {'shared': Stack, 'own': OwnMasters}

STEP_SECONDS = 15.0
"""Duration of each rate of a cell with steps [s]."""

Log = Callable[[str], None]


class Cells(NamedTuple):
    """What is measured: each method over each link."""
    shapers: Sequence[Shaper]
    rates: Sequence[float]
    """[Mbit/s]"""
    losses: Sequence[float]
    """Loss of UDP datagrams at the operator [%]."""
    methods: Sequence[str]
    """See METHODS; IDEAL is the offline reference for our method before it."""
    seconds: float
    """Duration of a cell [s]."""
    steps: Sequence[float] = ()
    """Rates of another cell for each shaper, STEP_SECONDS each [Mbit/s]; empty: none."""
    idle: float = 0.0
    """Rate of a cell in which nothing but one image stream, or not even that, is sent [Mbit/s]; 0: none."""
    masters: str = 'own'
    """Masters of our nodes, see MASTERS."""


def measure(cells: Cells, folder: pathlib.Path, log: Log) -> Dict[str, Any]:
    """Measure, and write all files into a folder.

    :return: {'clip': name, 'rows': [{'cell', 'method', ...}, ...], 'steps': likewise, 'idle': likewise}
    """
    install(cells.methods, log)
    folder.mkdir(parents=True, exist_ok=True)
    masters = MASTERS[cells.masters]
    rows: List[Row] = []
    steps: List[Row] = []
    idles: List[Row] = []
    for shaper, rate, loss in itertools.product(cells.shapers, cells.rates, cells.losses):
        cell = Cell(shaper, (1e6 * rate,), loss / 100, cells.seconds)
        rows += _compared(cell, cells.methods, masters, folder, log)
    for shaper in cells.shapers if cells.steps else ():
        cell = Cell(shaper, tuple(1e6 * rate for rate in cells.steps), 0.0, STEP_SECONDS)
        steps += _stepped(cell, [method for method in cells.methods if method != IDEAL], masters, folder, log)
    for shaper in cells.shapers if cells.idle else ():
        log('idle over %s' % shaper.name)
        idles += idle(Cell(shaper, (1e6 * cells.idle,), 0.0, cells.seconds), masters)
    results = {'clip': Clip().name, 'rows': rows, 'steps': steps, 'idle': idles}
    live_report.write(results, folder)
    return results


def install(wanted: Iterable[str], log: Log) -> None:
    """Install Debian's packages that the peers among these methods need.

    :raises subprocess.CalledProcessError: where they cannot be had
    """
    listed = subprocess.run(['dpkg-query', '-W', '-f', '${db:Status-Status} ${Package}\n'], stdout=subprocess.PIPE,
                            text=True).stdout.splitlines()
    missing = [name for name in PACKAGES if 'installed ' + name not in listed] if set(wanted) & set(WAYS) else []
    if missing:
        log('installing ' + ' '.join(missing))
        subprocess.run(['apt-get', '-qq', 'update'])     # may fail for one of several servers
        subprocess.run(['apt-get', '-qq', '-o', 'DPkg::Lock::Timeout=300', 'install', '-y', '--no-install-recommends',
                        *missing], check=True, stdout=subprocess.DEVNULL)


def _outcomes(cell: Cell, wanted: Sequence[str], masters: Type[Stack], folder: pathlib.Path, log: Log
              ) -> Iterator[Tuple[str, Outcome]]:
    """(method, what it showed) of each that showed anything, in this order; then their plot is drawn."""
    found: Dict[str, Outcome] = {}
    for method in wanted:
        log('%s: %s' % (cell.name, method))
        outcome = _referred(cell, found) if method == IDEAL else _measured(cell, method, masters, folder, log)
        if outcome is not None:
            found[method] = outcome
            yield method, outcome
    live_report.plot(cell.name, found, folder)


def _compared(cell: Cell, wanted: Sequence[str], masters: Type[Stack], folder: pathlib.Path, log: Log
              ) -> Iterator[Row]:
    """The rows of a cell, in the order of the methods."""
    for method, outcome in _outcomes(cell, wanted, masters, folder, log):
        row = {'cell': cell.name, 'method': method, 'link [Mbit/s]': 1e-6 * cell.rates[0], 'loss [%]': 100 * cell.loss,
               **judged(outcome.screen, outcome.samples, outcome.moments[0] + SETTLED, outcome.moments[-1])}
        log(live_report.line(row))
        yield row


def _stepped(cell: Cell, wanted: Sequence[str], masters: Type[Stack], folder: pathlib.Path, log: Log) -> Iterator[Row]:
    """A row for each method and each rate of a cell."""
    for method, outcome in _outcomes(cell, wanted, masters, folder, log):
        for rate, begun, ended in zip(cell.rates, outcome.moments, outcome.moments[1:]):
            yield {'cell': cell.name, 'method': method, 'rate': rate / 1e6,
                   **judged_step(outcome.screen, outcome.samples, begun, ended)}


def _referred(cell: Cell, found: Mapping[str, Outcome]) -> Optional[Outcome]:
    """What the first of our methods would have shown with the whole rate; None: none was measured."""
    from .live_ideal import ideal  # compiled codecs
    ours = next((found[method] for method in OURS if method in found), None)
    return ours and ours._replace(screen=ideal(cell, ours.screen), samples=[], notes={})


def _measured(cell: Cell, method: str, masters: Type[Stack], results: pathlib.Path, log: Log) -> Optional[Outcome]:
    """What a method showed; None: nothing. Its images, samples of the link and the nodes' output become files."""
    folder = results / live_report.slug(cell.name, method)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory() as scratch, LiveRun(
                cell, method, pathlib.Path(scratch), folder / 'nodes.log', masters) as live:
            outcome = live.measure()
    except RuntimeError as error:
        log(str(error))
        return None
    live_report.write_files(outcome, folder)
    return outcome
