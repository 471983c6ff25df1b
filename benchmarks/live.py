# SPDX-License-Identifier: BSD-3-Clause
"""A camera over a narrow link, live: the nodes as shipped beside what a user would pick instead, on the same link.

Needs root. Both sides run in network namespaces; a kernel's shaper or the link lab limits the rate between them. The
methods run one after the other. doc/experiments.md, "Live over a narrow link", says how to read the results.
"""
import argparse
import itertools
import pathlib
import subprocess
import tempfile
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Type

from evaluation import TOP
from evaluation.gst_pipelines import PACKAGES, WAYS
from evaluation.live_clip import Clip
from evaluation.live_idle import idle
from evaluation.live_run import OURS, Cell, LiveRun, Outcome
from evaluation.live_score import SETTLED, Row, judged, judged_step
from evaluation.own_masters import OwnMasters
from evaluation.shapers import Shaper, parse
from evaluation.stack import Stack

from . import live_report

RESULTS = TOP / 'results' / 'bench' / 'live'
IDEAL = 'ideal'
METHODS = (*OURS, IDEAL, *WAYS)
MASTERS: Dict[str, Type[Stack]] = {'shared': Stack, 'own': OwnMasters}

STEPS, STEP_SECONDS = (3.0, 0.5, 3.0), 15.0
"""[Mbit/s], [s]"""

QUICK: Dict[str, Any] = {'rates': [0.3, 1.0], 'losses': [0.0, 5.0], 'shapers': [parse('tbf6')], 'seconds': 15.0}

Log = Callable[[str], None]


def numbers(text: str) -> List[float]:
    """A list of numbers, as 0.3,1."""
    return [float(word) for word in text.split(',')] if text else []


def shapers(text: str) -> List[Shaper]:
    """A list of shapers by name."""
    return [parse(word) for word in text.split(',')]


def methods(text: str) -> List[str]:
    """:raises ValueError: naming what is no method"""
    unknown = set(text.split(',')) - set(METHODS)
    if unknown:
        raise ValueError('no method is named %s' % ', '.join(sorted(unknown)))
    return text.split(',')


def options(arguments: Sequence[str], quick: bool = False) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(
        prog='./smokebot bench live', description=(__doc__ or '').split('\n')[0],
        epilog='methods: ' + ', '.join(METHODS) + '; ideal: the offline reference for our method before it')
    parser.add_argument('--rates', type=numbers, default=[0.3, 1.0, 3.0, 10.0], help='[Mbit/s]; empty: none')
    parser.add_argument('--losses', type=numbers, default=[0.0, 5.0, 20.0, 50.0], help='of UDP at the operator [%%]')
    parser.add_argument('--shapers', type=shapers, default=shapers('tbf6,tbf32,lab'),
                        help='tbf1.5, tbf6, tbf32, htb, lab, wifi, each with /QUEUE [ms] (200)')
    parser.add_argument('--methods', type=methods, default=methods('ours,layered,ideal,gst,fec,rtx,srt'))
    parser.add_argument('--seconds', type=float, default=30.0, help='of each cell')
    parser.add_argument('--steps', type=numbers, default=list(STEPS), help='rates of a cell [Mbit/s]; empty: none')
    parser.add_argument('--idle', type=float, default=0.3, metavar='RATE', help='of the idle cell [Mbit/s]; 0: none')
    parser.add_argument('--masters', choices=MASTERS, default='shared', help='of our nodes')
    if quick:
        parser.set_defaults(**QUICK)
    return parser.parse_args(arguments)


def run(log: Log, quick: bool = False, arguments: Sequence[str] = ()) -> Dict[str, Any]:
    """As `measure`."""
    return measure(options(arguments, quick), RESULTS, log)


def measure(chosen: argparse.Namespace, folder: pathlib.Path, log: Log) -> Dict[str, Any]:
    """Measure, and write all files into a folder.

    :param chosen: see `options`
    :return: {'clip': name, 'rows': [{'cell', 'method', ...}, ...], 'steps': likewise, 'idle': likewise}
    """
    install(chosen.methods, log)
    folder.mkdir(parents=True, exist_ok=True)
    masters = MASTERS[chosen.masters]
    results: Dict[str, Any] = {'clip': Clip().name, 'rows': [], 'steps': [], 'idle': []}
    for shaper, rate, loss in itertools.product(chosen.shapers, chosen.rates, chosen.losses):
        cell = Cell(shaper, (1e6 * rate,), loss / 100, chosen.seconds)
        results['rows'] += compared(cell, chosen.methods, masters, folder, log)
    for shaper in chosen.shapers if chosen.steps else ():
        cell = Cell(shaper, tuple(1e6 * rate for rate in chosen.steps), 0.0, STEP_SECONDS)
        live_methods = [method for method in chosen.methods if method != IDEAL]
        results['steps'] += stepped(cell, live_methods, masters, folder, log)
    for shaper in chosen.shapers if chosen.idle else ():
        log('idle over %s' % shaper.name)
        results['idle'] += idle(Cell(shaper, (1e6 * chosen.idle,), 0.0, chosen.seconds), masters)
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


def compared(cell: Cell, wanted: Sequence[str], masters: Type[Stack], folder: pathlib.Path, log: Log
             ) -> Iterator[Row]:
    """The rows of a cell, in the order of the methods."""
    found: Dict[str, Outcome] = {}
    for method in wanted:
        log('%s: %s' % (cell.name, method))
        outcome = referred(cell, found) if method == IDEAL else measured(cell, method, masters, folder, log)
        if outcome is not None:
            found[method] = outcome
            row = {'cell': cell.name, 'method': method, 'link [Mbit/s]': 1e-6 * cell.rates[0],
                   'loss [%]': 100 * cell.loss,
                   **judged(outcome.screen, outcome.told, outcome.moments[0] + SETTLED, outcome.moments[-1])}
            log(live_report.line(row))
            yield row
    live_report.plot(cell.name, found, folder)


def referred(cell: Cell, found: Mapping[str, Outcome]) -> Optional[Outcome]:
    """What the first of our methods would have shown with the whole rate; None: none was measured."""
    from evaluation.live_ideal import ideal  # compiled codecs
    ours = next((found[method] for method in OURS if method in found), None)
    return ours and ours._replace(screen=ideal(cell, ours.screen), told=[], notes={})


def measured(cell: Cell, method: str, masters: Type[Stack], results: pathlib.Path, log: Log) -> Optional[Outcome]:
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


def stepped(cell: Cell, wanted: Sequence[str], masters: Type[Stack], folder: pathlib.Path, log: Log) -> Iterator[Row]:
    """A row for each method and each rate of a cell."""
    found: Dict[str, Outcome] = {}
    for method in wanted:
        log('%s: %s' % (cell.name, method))
        outcome = measured(cell, method, masters, folder, log)
        if outcome is not None:
            found[method] = outcome
            for rate, begun, ended in zip(cell.rates, outcome.moments, outcome.moments[1:]):
                yield {'cell': cell.name, 'method': method, 'rate': rate / 1e6,
                       **judged_step(outcome.screen, outcome.told, begun, ended)}
    live_report.plot(cell.name, found, folder)


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    return live_report.text(results)
