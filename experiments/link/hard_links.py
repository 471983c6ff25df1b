# SPDX-License-Identifier: BSD-3-Clause
"""Links on which congestion control is hard: jitter, short queues, a policer, TCP downloads beside us."""
import contextlib
import pathlib
import time
from typing import Any, ContextManager, List, Mapping, NamedTuple, Optional, Sequence, Union

from evaluation import rate_steps
from evaluation.rate_steps import METHODS, DisplayHistory, RateStepRun, Step
from evaluation.tcp_download import download

from .. import table
from ..goals import Goal, lost, queue, share, unmet, used
from ..runner import Figure, Run, Table
from .adaptation import OURS

TITLE = 'Links on which congestion control is hard'

EXPLANATION = """
The same nodes and data as in *Adapting to the link* (images interleaved, a rate that follows the link), over links on
which congestion control is hard, without random loss and with 20 ms of delay each way: jitter of 10 ms to either side;
a queue of 10 ms only, which is full before it is seen; a policer, which has no queue, but drops at once what exceeds
its rate and a token bucket; and a TCP download from the robot's side to the operator's, over the same link and its
queue of 200 ms. For each link robot_sender starts again over a good one of 20 Mbit/s, so that it knows nothing of the
link before. As soon as an image arrives, the link begins. A download begins 5 s later, or, where it is *first*, with
the link. It is measured for 10 s, from 3 s after that.

*Used* is the part of the link that our datagrams took, *by all* with everything else that the robot's side sent. *Own
loss* is which part of our datagrams a full queue or the policer dropped. *Share* is our part of what the link carried
of both, *TCP* what it carried of the download. *Late* is how late the emulated link was itself (p99 of each quarter of
a second, their median): packets that it takes late find a short queue, or a small bucket, together.
"""

SETTLE = 1.0
"""From a change of the link to the measured step, whose first part, rate_steps.STEADY, does not count either [s]."""

SECONDS, QUICK_SECONDS = 10.0, 3.0
"""Duration of the measurement of a link, in a full and in a quick run [s]."""

RATES = 5e6, 20e6
"""Rates of the links [bit/s]."""

SHORT_QUEUE, JITTER = 0.01, 0.01
"""Length of the short queue, and jitter, of the links that have them [s]."""

ALONE_FIRST = 5.0
"""Time from the start of the link to that of a download, unless the download is first [s]."""

BUCKET = 15e3
"""Size of the policer's token bucket: 24 ms at its rate [byte]."""

ALONE = used(85), lost(1)
BESIDE_TCP = share(30, 70)
"""Goals of a link without and with a TCP download beside us."""


class HardLink(NamedTuple):
    """A link, and what has to be reached there."""
    name: str
    rate: float
    """[bit/s]"""
    goals: Sequence[Goal]
    conditions: Mapping[str, float] = {}
    """{name: value} of LinkConditions, besides those of RateStepRun.set_link"""
    tcp: Optional[str] = None
    """The congestion control of a download beside us; None: there is none."""
    tcp_after: float = ALONE_FIRST
    """When it begins [s]."""


def _name(words: str, rate: float) -> str:
    return '%s, %g Mbit/s' % (words, rate / 1e6)


LINKS = [
    *[HardLink(_name('jitter of 10 ms', rate), rate, (*ALONE, queue(60)), {'jitter': JITTER}) for rate in RATES],
    *[HardLink(_name('queue of 10 ms', rate), rate, ALONE, {'queue': SHORT_QUEUE}) for rate in RATES],
    HardLink(_name('policer', RATES[0]) + ', 15 kB', RATES[0], ALONE, {'bucket': BUCKET}),
    *[HardLink(_name('beside TCP %s' % tcp, rate), rate, BESIDE_TCP, tcp=tcp)
      for tcp in ('cubic', 'bbr') for rate in RATES],
    *[HardLink(_name('TCP %s first' % tcp, RATES[0]), RATES[0], BESIDE_TCP, tcp=tcp, tcp_after=0.0)
      for tcp in ('cubic', 'bbr')]]


def run(run: Run) -> None:
    """Write links.csv."""
    seconds = QUICK_SECONDS if run.quick else SECONDS
    with RateStepRun(METHODS[OURS], run.seed, run.folder) as link:
        steps = [(hard, measure(link, hard, seconds)) for hard in run.steps(LINKS, lambda hard: hard.name)]
        display = DisplayHistory(link)
        table.write(run.folder / 'links.csv', [row(link, hard, step, display) for hard, step in steps])


def measure(link: RateStepRun, hard: HardLink, seconds: float) -> Step:
    """One link, with a new sender."""
    link.restart_sender()
    link.set_link(hard.rate, 0.0, **hard.conditions)
    if hard.tcp:
        time.sleep(hard.tcp_after)
    beside: ContextManager[Any] = download(link.stack, hard.tcp) if hard.tcp else contextlib.nullcontext()
    with beside:
        step, = link.on_time(lambda: time.sleep(SETTLE), lambda: link.measure(
            0.0, rate_steps.STEADY + seconds, [hard.rate], **hard.conditions))
    return step


def row(link: RateStepRun, hard: HardLink, step: Step, display: DisplayHistory) -> table.Row:
    """The row of a link in links.csv."""
    all_, ours = rate_steps.link_row(step), rate_steps.flow_row(step)
    if hard.tcp is None:        # what the ROS master says does not count
        ours.update({'share [%]': None, 'TCP [Mbit/s]': None})
    odom = rate_steps.message_row(list(link.robot.heard), list(link.operator.heard), step,
                                  link.method.protected[rate_steps.ODOM])
    shown = display.row(step.begun + rate_steps.STEADY, step.ended)
    return {'link': hard.name, **ours, 'by all [%]': all_['used [%]'],
            **{key: all_[key] for key in ('queue p50 [ms]', 'queue p95 [ms]', 'late p99 [ms]')},
            **{key: shown[key] for key in ('pictures [Hz]', 'age p50 [ms]', 'age p99 [ms]', 'PSNR [dB]')},
            **{'odom ' + key: value for key, value in odom.items()}}


COLUMNS = {'used [%]': 'used [%]', 'by all [%]': 'by all [%]', 'own loss [%]': 'own loss [%]',
           'queue p50 [ms]': 'queue p50 [ms]', 'p95 [ms]': 'queue p95 [ms]', 'images [Hz]': 'pictures [Hz]',
           'image age p50 [ms]': 'age p50 [ms]', 'odom age p99 [ms]': 'odom age p99 [ms]', 'share [%]': 'share [%]',
           'TCP [Mbit/s]': 'TCP [Mbit/s]', 'late [ms]': 'late p99 [ms]'}
"""{column of the table: column of links.csv}"""


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The table."""
    return [links_table(folder)]


def links_table(folder: pathlib.Path) -> Table:
    """What was measured; what misses its goal is bold."""
    rows: List[Sequence[Any]] = []
    for measured in table.read(folder / 'links.csv'):
        bold = {goal.quantity for goal in unmet(goals_of(measured), measured)}
        rows.append([measured['link'], *('**%s**' % shown(measured[key]) if key in bold else shown(measured[key])
                                         for key in COLUMNS.values())])
    return Table('One run. Goals: alone used ≥ 85 % and own loss ≤ 1 %, with jitter also queue p95 ≤ 60 ms; beside TCP '
                 'a share of 30 to 70 %. What misses its goal is bold.', ['link', *COLUMNS], rows)


def shown(value: Any) -> str:
    """A number of the table."""
    return '' if value is None else '%.3g' % value


def goals_of(measured: table.Row) -> Sequence[Goal]:
    """The goals of a row of links.csv; none of a link that is no longer measured."""
    return next((hard.goals for hard in LINKS if hard.name == measured['link']), ())


def missed(folder: pathlib.Path) -> List[str]:
    """Goals that were missed."""
    return ['%s: %s %s, goal %s' % (measured['link'], goal.quantity, shown(measured[goal.quantity]), goal)
            for measured in table.read(folder / 'links.csv') for goal in unmet(goals_of(measured), measured)]


DOC_TABLES = {'links': links_table}
