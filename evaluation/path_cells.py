# SPDX-License-Identifier: BSD-3-Clause
"""Two links at once beside each of them alone, live: the nodes as shipped, own masters, sealed.

Needs root. The links are link_lab's, with seeds of their own, or a kernel's shapers. Beside the nodes, JPEG over the
kernel's multipath TCP.
"""
import pathlib
import statistics
import tempfile
import time
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple, Union

from smokebot_udp.demo.link import FIRST_OF_TWO as FIRST
from smokebot_udp.demo.link import SECOND_OF_TWO as SECOND

from .live_score import SETTLED, judged
from .mptcp_method import Jpeg
from .path_links import Conditions, LabLinks, ShapedLinks
from .path_run import PathRun, Seen
from .shapers import Shaper, parse

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

AFTER_SWAP = 0.5
"""What is shown until this long after a swap is also left out, to see how long it costs quality [s]."""

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


def measured(case: Case, seconds: float, number: int, log: Log, folder: pathlib.Path) -> Iterator[Row]:
    """The row of a case; none where no image comes, which is logged.

    :param number: of the run, which decides the seeds
    :param folder: for the log of both sides
    """
    try:
        with tempfile.TemporaryDirectory() as scratch, links_of(case, 1 + 2 * number) as links, PathRun(
                links, pathlib.Path(scratch), folder / 'nodes.log', case.jpeg) as running:
            running.settle(SETTLED)
            begun, swaps = running.moment(), []     # type: Any, List[float]
            if case.swaps and isinstance(links, LabLinks):
                swaps = swap(links, seconds)
            else:
                time.sleep(seconds)
            row = judged_row(case, running.seen(begun, running.moment()), swaps)
    except RuntimeError as error:
        log('%s: %s' % (case.name, error))
        return
    yield row


def links_of(case: Case, seed: int) -> Union[LabLinks, ShapedLinks]:
    """The links of a case."""
    return ShapedLinks(case.links, case.shaper) if case.shaper else LabLinks(case.links, seed)


def swap(links: LabLinks, seconds: float) -> List[float]:
    """Exchange the rates of both links each SWAP_PERIOD; when, by time.time() [s]."""
    until, rates, swaps = time.monotonic() + seconds, (FAST, SLOW), []   # type: float, Any, List[float]
    while time.monotonic() < until:
        time.sleep(SWAP_PERIOD)
        rates = rates[::-1]
        swaps.append(time.time())
        for lab, rate in zip(links.labs, rates):
            lab.set({**FIRST, 'rate': rate})
    return swaps


def judged_row(case: Case, seen: Seen, swaps: Sequence[float] = ()) -> Row:
    """The row of what was seen.

    :param swaps: when the links exchanged their rates
    """
    used = [carried / (1e-6 * link['rate']) for carried, link in zip(seen.carried, case.links)]
    apart = [psnr for when, psnr in seen.screen.course(seen.begun, seen.ended)
             if not any(0 <= when - one < AFTER_SWAP for one in swaps)]
    return {'case': case.name, **judged(seen.screen, [], seen.begun, seen.ended), 'used': used,
            'screen apart from swaps [dB]': statistics.fmean(apart) if apart else None,
            'carried [Mbit/s]': seen.carried, 'CPU': seen.cpu}
