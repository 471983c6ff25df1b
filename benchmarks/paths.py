# SPDX-License-Identifier: BSD-3-Clause
"""Two links at once beside each of them alone, live: the nodes as shipped, own masters, sealed.

Needs root. The links are link_lab's, with seeds of their own, or a kernel's shapers. Beside the nodes, JPEG over the
kernel's multipath TCP. doc/own_masters.md, "A robot with several addresses", has results.
"""
import argparse
import pathlib
import tempfile
import time
from typing import Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from evaluation import TOP
from evaluation.live_clip import Clip
from evaluation.live_score import SETTLED, judged
from evaluation.mptcp_method import Jpeg
from evaluation.path_links import Conditions, LabLinks, ShapedLinks
from evaluation.path_run import PathRun, Seen
from evaluation.shapers import Shaper, parse
from smokebot_udp.demo.link import FIRST_OF_TWO as FIRST
from smokebot_udp.demo.link import SECOND_OF_TWO as SECOND

RESULTS = TOP / 'results' / 'bench' / 'paths'

ONE = {'rate': 2.7e6, 'delay': 0.0175, 'queue': 0.2}
"""The one link that both are to be as good as."""

NARROW, NARROWER = {**FIRST, 'rate': 0.4e6}, {**SECOND, 'rate': 0.2e6}
"""A fifth of the rates: images want all of it."""

HALF, HALF_SECOND = {**FIRST, 'rate': 1e6}, {**SECOND, 'rate': 0.5e6}
"""Half of the rates."""

BURSTS = {**FIRST, 'loss': 0.6, 'burst': 8.0}
FAR = {**SECOND, 'delay': 0.15}
"""A link that loses 60 % in bursts of 50 ms, which are eight datagrams, and one of 150 ms."""

TBF = parse('tbf6')
"""The kernel's shaper: a token bucket with a burst of 6 kB and a queue of 200 ms, at the rates of FIRST and SECOND."""

CUBIC, BBR = Jpeg(60, 'cubic'), Jpeg(60, 'bbr')
"""JPEG over multipath TCP, its quality set by hand: images take 85 % of the rates of FIRST and SECOND together, headers
included, as the bit rate of gst_pipelines does."""

CUBIC_LOSSY = Jpeg(30, 'cubic')
"""The same of what cubic gets of both links where 5 % are lost, 1.8 Mbit/s."""

FAST, SLOW, SWAP_PERIOD = 20e6, 0.3e6, 3.0
"""Rates of two links that exchange them, and how often [bit/s, bit/s, s]."""

Log = Callable[[str], None]
Row = Dict[str, Any]


class Case(NamedTuple):
    """A row of the table."""
    name: str
    links: Tuple[Conditions, ...]
    swaps: bool = False
    """Whether both links change their rates each SWAP_PERIOD. Those of the link lab can."""
    shaper: Optional[Shaper] = None
    """The kernel's, of each link; None: they are link_lab's."""
    jpeg: Optional[Jpeg] = None
    """See PathRun."""


def lossy(link: Conditions, loss: float) -> Conditions:
    """The same link that loses datagrams."""
    return {**link, 'loss': loss}


def ways(name: str, first: Conditions, second: Conditions, shaper: Optional[Shaper] = None) -> List[Case]:
    """Both links, and each of them alone."""
    return [Case('%s: %s' % (name, which), links, shaper=shaper) for which, links in (
        ('both', (first, second)), ('the first', (first,)), ('the second', (second,)))]


def multipath(name: str, loss: float, jpegs: Sequence[Jpeg], shaper: Optional[Shaper] = None) -> List[Case]:
    """JPEG over multipath TCP by both links. A kernel's shaper loses no TCP."""
    return [Case('%s: MPTCP, %s, JPEG %d' % (name, jpeg.congestion_control, jpeg.quality),
                 (lossy(FIRST, loss), lossy(SECOND, loss)), shaper=shaper, jpeg=jpeg) for jpeg in jpegs]


FAST_NOW, SLOW_NOW = {**FIRST, 'rate': FAST}, {**FIRST, 'rate': SLOW}
CASES = [*ways('0 %', FIRST, SECOND), Case('0 %: one of 2.7 Mbit/s', (ONE,)),
         *ways('narrow', NARROW, NARROWER), Case('narrow: one of 0.54 Mbit/s', ({**ONE, 'rate': 0.54e6},)),
         *ways('half', HALF, HALF_SECOND), Case('half: one of 1.35 Mbit/s', ({**ONE, 'rate': 1.35e6},)),
         *ways('5 %', lossy(FIRST, 0.05), lossy(SECOND, 0.05)), Case('5 %: one of 2.7 Mbit/s', (lossy(ONE, 0.05),)),
         *ways('bursts, far', BURSTS, FAR),
         Case('swapped: both', (FAST_NOW, SLOW_NOW), True), Case('steady: both', (FAST_NOW, SLOW_NOW)),
         *ways('tbf, 0 %', FIRST, SECOND, TBF), *ways('tbf, 5 %', lossy(FIRST, 0.05), lossy(SECOND, 0.05), TBF),
         *multipath('0 %', 0.0, [CUBIC, BBR]), *multipath('5 %', 0.05, [CUBIC, CUBIC_LOSSY, BBR]),
         *multipath('tbf, 0 %', 0.0, [CUBIC, BBR], TBF)]


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
    rows = [row for number in range(chosen.runs) for case in cases for row in measured(case, seconds, number, log)]
    return {'clip': Clip().name, 'rows': rows}


def measured(case: Case, seconds: float, number: int, log: Log) -> Iterator[Row]:
    """The row of a case; none where no image comes."""
    try:
        with tempfile.TemporaryDirectory() as scratch, links_of(case, 1 + 2 * number) as links, PathRun(
                links, pathlib.Path(scratch), RESULTS / 'nodes.log', case.jpeg) as running:
            running.settle(SETTLED)
            begun = running.moment()
            if case.swaps and isinstance(links, LabLinks):
                swap(links, seconds)
            else:
                time.sleep(seconds)
            row = judged_row(case, running.seen(begun, running.moment()))
    except RuntimeError as error:
        log('%s: %s' % (case.name, error))
        return
    log(line(row))
    yield row


def links_of(case: Case, seed: int) -> Union[LabLinks, ShapedLinks]:
    """The links of a case."""
    return ShapedLinks(case.links, case.shaper) if case.shaper else LabLinks(case.links, seed)


def swap(links: LabLinks, seconds: float) -> None:
    """Exchange the rates of both links each SWAP_PERIOD."""
    until, rates = time.monotonic() + seconds, (FAST, SLOW)
    while time.monotonic() < until:
        time.sleep(SWAP_PERIOD)
        rates = rates[::-1]
        for lab, rate in zip(links.labs, rates):
            lab.set({**FIRST, 'rate': rate})


def judged_row(case: Case, seen: Seen) -> Row:
    """The row of what was seen."""
    used = [carried / (1e-6 * link['rate']) for carried, link in zip(seen.carried, case.links)]
    return {'case': case.name, **judged(seen.screen, [], seen.begun, seen.ended), 'used': used,
            'carried [Mbit/s]': seen.carried, 'CPU': seen.cpu}


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
