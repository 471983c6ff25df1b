# SPDX-License-Identifier: BSD-3-Clause
"""Two links to one robot at once, beside each of them alone, an operator who switches by hand, and multipath TCP."""
import json
import pathlib
import time
from typing import Any, Dict, List, NamedTuple, Sequence, Union

from evaluation.path_cells import AFTER_SWAP, CASES, Case, measured
from evaluation.path_cuts import AGE, COMMAND, GAP, REACTION, SETTLED, TOPICS, PathCuts, cut_again, spread
from smokebot_udp.link_lab.second_link import SECOND_DEVICE

from ..runner import Figure, Run, Table

TITLE = 'Two links to one robot at once'

EXPLANATION = """
A robot has two addresses: one over a link of 2 Mbit/s and 10 ms each way, one over 1 Mbit/s and 30 ms. Both nodes have
their default settings and a master each. A camera of 752 x 480 pixels, grey, takes 10 images a second. Links are those
of the link lab, or the kernel's token buckets (*tbf*: burst 6 kB, queue 200 ms, no delay). *One* is a single link of
2.7 Mbit/s and 17.5 ms. *Bursts, far*: the first link loses 60 % in bursts of 50 ms, the second one takes 150 ms.
*Swapped*: the links have 20 and 0.3 Mbit/s, and exchange these rates each 3 s.
"""

SECONDS, QUICK_SECONDS = 20.0, 8.0
CUTS, BY_HAND, CUT = 50, 6, 5.0
"""Number of cuts, and of those beside an operator who switches by hand; how long each is [s]."""

LEFT_OUT = 'narrow', 'half'
"""Cases of `bench paths` that are no part of this."""

SCREEN, ONE = 'screen mean [dB]', ': one of 2.7 Mbit/s'
TORN = 'bursts, far: both', 'bursts, far: the first', 'bursts, far: the second'
MPTCP = 'MPTCP'     # in the name of a case: what the nodes need is of no interest there
NODES, HAND = 'two addresses', 'one, switched by hand'


class Checked(NamedTuple):
    """A goal, and what was measured."""
    name: str
    goal: str
    value: str
    met: bool


def cases(quick: bool) -> List[Case]:
    """The cases that are measured."""
    chosen = [case for case in CASES if not case.name.startswith(LEFT_OUT)]
    return chosen[:2] if quick else chosen


def run(run: Run) -> None:
    """Write results.json."""
    seconds = QUICK_SECONDS if run.quick else SECONDS
    rows = [row for case in run.steps(cases(run.quick), lambda case: case.name)
            for row in measured(case, seconds, run.seed - 1, print, run.folder)]
    counts = {NODES: 2 if run.quick else CUTS, HAND: 1 if run.quick else BY_HAND}
    cuts = {name: cut_again(count, CUT, by_hand=name == HAND) for name, count in counts.items()}
    results = {'rows': rows, 'cuts': cuts, 'metered': metered_rate()}
    (run.folder / 'results.json').write_text(json.dumps(results, default=float))


def metered_rate() -> float:
    """What a metered second link carries beside a good first one, each way, the larger number [byte/s]."""
    with PathCuts(sender=['_metered:=' + SECOND_DEVICE]) as run:
        time.sleep(SETTLED)
        return run.idle_rate(10.0)


def load(folder: pathlib.Path) -> Dict[str, Any]:
    """What was measured: {'rows': of path_cells.judged_row, 'cuts': {who: of cut_again}, 'metered': [byte/s]}."""
    found: Dict[str, Any] = json.loads((folder / 'results.json').read_text())
    return found


def missed(folder: pathlib.Path) -> List[str]:
    """Goals that were missed."""
    return ['%s: %s, should be %s' % (one.name, one.value, one.goal) for one in checked(folder) if not one.met]


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The tables."""
    return [make(folder) for make in DOC_TABLES.values()]


def links_table(folder: pathlib.Path) -> Table:
    """What was shown over which links."""
    head = ['links', 'screen mean, 5 % [dB]', 'images mean [dB]', 'age p50, p95 [ms]', 'longest freeze [s]',
            'used', 'CPU of robot_sender']
    return Table('The screen beside what the camera sees at the moment; the images shown beside those taken; the part '
                 'of each link that was used. The quality of the JPEG over multipath TCP was set by hand.', head,
                 [[row['case'], '%.1f, %.1f' % (row['screen mean [dB]'], row['screen 5 % [dB]']),
                   '%.1f' % row['image mean [dB]'], '%.0f, %.0f' % (1e3 * row['age p50 [s]'], 1e3 * row['age p95 [s]']),
                   '%.2f' % row['freeze [s]'], ', '.join('%.2f' % used for used in row['used']),
                   '' if MPTCP in row['case'] else '%.2f' % row['CPU']]
                  for row in load(folder)['rows'] if row['age p50 [s]'] is not None])


def cuts_table(folder: pathlib.Path) -> Table:
    """What a cut of the preferred link costs."""
    rows = []
    for who, found in load(folder)['cuts'].items():
        for topic in (*TOPICS, COMMAND):
            ages = '' if topic == COMMAND else _text(found[AGE][topic])
            rows.append([who, topic, len(found[GAP][topic]), _text(found[GAP][topic]), ages])
    return Table('The first link is cut for %g s again and again, at random moments: the longest time without a '
                 'message, and the age of the newest one just before the next one comes; median, 95th percentile and '
                 'most of all cuts [s]. By hand: an operator notices a cut after %g s, and starts the receiver with '
                 'the other address.' % (CUT, REACTION), ['desk', 'topic', 'cuts', 'gap', 'age'], rows)


def goals_table(folder: pathlib.Path) -> Table:
    """What was to be reached."""
    return Table('Goals of two links at once.', ['', 'goal', 'measured', 'met'],
                 [[one.name, one.goal, one.value, 'yes' if one.met else '**no**'] for one in checked(folder)])


DOC_TABLES = {'links': links_table, 'cuts': cuts_table, 'goals': goals_table}


def checked(folder: pathlib.Path) -> List[Checked]:
    """The goals. One is left out if a row that it needs was not measured."""
    found = load(folder)
    rows: Dict[str, Dict[str, Any]] = {row['case']: row for row in found['rows']}
    cuts, goals = found['cuts'][NODES], []      # type: Any, List[Checked]
    for name in ('0 %', '5 %'):
        if name + ': both' in rows and name + ONE in rows:
            goals.append(_least('screen beside one of 2.7 Mbit/s, %s lost' % name, rows[name + ONE][SCREEN] - 0.5,
                                rows[name + ': both'][SCREEN]))
    if {'0 %: both', '0 %: the first'} <= set(rows):
        both, first = rows['0 %: both'], rows['0 %: the first']
        goals.append(Checked('used of each', '≥ 0.85', ', '.join('%.2f' % used for used in both['used']),
                             min(both['used']) >= 0.85))
        goals.append(_most('CPU of the robot beside one link', 1.15, both['CPU'] / first['CPU'], ''))
    if set(TORN) <= set(rows):
        both, *alone = (rows[name] for name in TORN)
        goals.append(_least('bursts, far: screen beside the better one', max(row[SCREEN] for row in alone),
                            both[SCREEN]))
        goals.append(_most('bursts, far: age p95 beside the younger one', min(row['age p95 [s]'] for row in alone),
                           both['age p95 [s]'], ' s'))
    if {'swapped: both', 'steady: both'} <= set(rows):
        apart = 'screen apart from swaps [dB]'
        goals.append(_least('swapped, but for %g s after each swap, beside steady' % AFTER_SWAP,
                            rows['steady: both'][apart] - 1.5, rows['swapped: both'][apart]))
    goals += [_most('cuts: age of %s at most' % topic, 0.45, max(cuts[AGE][topic]), ' s')
              for topic in TOPICS if 'image' in topic]
    goals.append(_most('cuts: gap of commands at most', 0.15, max(cuts[GAP][COMMAND]), ' s'))
    goals.append(_most('metered and idle', 2.0, 1e-3 * found['metered'], ' kB/s'))
    return goals


def _least(name: str, least: float, value: float) -> Checked:
    return Checked(name, '≥ %.1f dB' % least, '%.1f dB' % value, value >= least)


def _most(name: str, most: float, value: float, unit: str) -> Checked:
    return Checked(name, '≤ %.3g%s' % (most, unit), '%.3g%s' % (value, unit), value <= most)


def _text(values: Sequence[float]) -> str:
    return '%.2f, %.2f, %.2f' % tuple(spread(values))
