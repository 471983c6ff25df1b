# SPDX-License-Identifier: BSD-3-Clause
"""Congestion control over simulated links: a link whose rate changes in steps, and an air that many robots share."""
import pathlib
import random
from dataclasses import replace
from typing import Any, Callable, Dict, List, Tuple, Union

import numpy as np

from evaluation.simulated_air import Events, Greedy, Load, Robot
from evaluation.simulated_streams import Streams, navigation
from smokebot_udp.link_lab.channel import Channel, LinkConditions

from .. import drawing, table
from ..runner import Figure, Run, Table
from . import scenario_results

TITLE = 'Congestion control, simulated'

EXPLANATION = """
What is sent should follow what the link carries. Here the package's own code (the receiver's reports, the link
controller of robot_sender with its estimate and its division among the streams, the packet scheduler) runs over the
link lab's channel, event by event and faster than real time. Datagrams have sizes and times, and no content.

**A link whose rate changes in steps**, 20 → 5 → 1 → 0.3 → 20 Mbit/s, with a delay of 20 ms, a queue of 200 ms, and
0, 5 or 20 % random loss, of reports, too. First with a sender that always has more, which shows the estimate alone;
then with a robot's streams, which can be turned down only in steps, and protected streams (tf, odometry, gas,
battery).

**A shared air**: 1, 10 and 100 robots, which start within five seconds and always have more to send, over one queue of
20 Mbit/s. They notice each other only by the queue's delay. Jain's index is 1 if all get the same, and 1/n if one gets
everything.

**Hard links** (scenarios.py): jitter, a queue that drops before it is seen, a policer, sudden loss, sudden changes,
aggregates, an asymmetric path, several robots, TCP downloads beside us.
"""

STEPS = 20, 5, 1, 0.3, 20
"""Rates of the link [Mbit/s]."""

EACH = 10.0
"""Duration of a step [s]."""

SETTLED = 2.0
"""A step is judged from this time after its start [s]."""

LOSSES = 0.0, 0.05, 0.2
SEEDS = 10
DELAY = 0.02
"""One way [s]."""

QUEUE = 0.2
"""[s]"""

SHARED = 20.0
"""Rate of the shared air [Mbit/s]."""

CROWDS = {1: 40.0, 10: 40.0, 100: 25.0}
"""{number of robots: simulated time [s]}"""

BIN = 0.1
"""Rates and queues are drawn over this long [s]."""


def channels(rate: float, loss: float, seed: int) -> Tuple[Channel, Channel]:
    """(channel of the datagrams, channel of the reports)"""
    return (Channel(LinkConditions(rate=rate * 1e6, loss=loss, delay=DELAY, queue=QUEUE), seed),
            Channel(LinkConditions(loss=loss, delay=DELAY), seed + 1000))


def over_steps(loss: float, seed: int, load: Load) -> Tuple[Robot, List[int]]:
    """(the robot, datagrams that the queue dropped after the first second of each step)"""
    events, dropped = Events(), []
    there, back = channels(STEPS[0], loss, seed)
    robot = Robot(events, there, back, load, seed)
    for number, rate in enumerate(STEPS):
        there.conditions = replace(there.conditions, rate=rate * 1e6)
        events.run(number * EACH + 1)
        before = there.counts.dropped
        events.run((number + 1) * EACH)
        dropped.append(there.counts.dropped - before)
    return robot, dropped


def judged(robot: Robot, number: int) -> Dict[str, float]:
    """{quantity: value} of one step, from SETTLED."""
    since, until = number * EACH + SETTLED, (number + 1) * EACH
    sent = np.array(robot.sent)
    sent = sent[(sent[:, 0] >= since) & (sent[:, 0] < until)]
    return {'used': sent[:, 1].sum() * 8e-6 / (until - since) / STEPS[number],
            'queue_p95': 1e3 * float(np.percentile(sent[:, 2], 95))}


def judged_streams(robot: Robot, streams: Streams, number: int) -> Dict[str, float]:
    """{quantity: value} of one step with a robot's streams."""
    since, until = number * EACH + SETTLED, (number + 1) * EACH
    ages = [when - left for when, name, _, _, left in robot.came if name in streams.protected and since <= left < until]
    images = {frame for when, name, frame, _, _ in robot.came if name == 'thermal' and since <= when < until}
    left = sum(since <= when < until for when in streams.published)
    return {'protected_lost': max(0.0, 1 - len(ages) / left), 'protected_p99': 1e3 * float(np.percentile(ages, 99)),
            'pictures': len(images) / (until - since)}


def in_bins(robot: Robot, until: float) -> List[Dict[str, float]]:
    """Rows of what was sent [Mbit/s], and of the longest wait [ms], for each BIN."""
    sent = np.array(robot.sent)
    bins = (sent[:, 0] / BIN).astype(int)
    rate, wait = np.bincount(bins, sent[:, 1], int(until / BIN)) * 8e-6 / BIN, np.zeros(int(until / BIN) + 1)
    np.maximum.at(wait, bins, sent[:, 2])
    return [{'time': BIN * at, 'sent': rate[at], 'wait': 1e3 * wait[at]} for at in range(int(until / BIN))]


def crowd(robots: int, seconds: float, seed: int) -> Tuple[List[Dict[str, float]], Any]:
    """A shared air: (rows of utilisation, fairness and queue for each second, counts of the channel)."""
    events, draw = Events(), random.Random(seed)
    there, back = channels(SHARED, 0.0, seed)
    all_ = [Robot(events, there, back, Greedy(draw.uniform(0, 5)), 1000 * seed + number)
            for number in range(robots)]
    events.run(seconds)
    bytes_ = np.zeros((robots, int(seconds)))
    waits: List[List[float]] = [[] for _ in range(int(seconds))]
    for number, robot in enumerate(all_):
        for when, size, wait in robot.sent:
            if when < seconds:
                bytes_[number, int(when)] += size * (wait <= QUEUE)     # what waits longer is dropped
                waits[int(when)].append(wait)
    rows: List[Dict[str, float]] = []
    for second in range(2, int(seconds)):
        got = bytes_[:, second - 2:second + 1].sum(axis=1)      # over three seconds: datagrams are few
        rows.append({'robots': robots, 'second': second, 'used': got.sum() * 8e-6 / 3 / SHARED,
                     'jain': got.sum() ** 2 / (robots * (got ** 2).sum()),
                     'wait': 1e3 * float(np.percentile(waits[second], 95))})
    return rows, there.counts


def run(run: Run) -> None:
    """Write scenarios.csv, steps.csv, course_LOSS.csv, crowds.csv and dropped.csv."""
    scenario_results.measure(run)
    seeds = 3 if run.quick else SEEDS
    rows = []
    for loss, seed in run.steps([(loss, seed) for loss in LOSSES for seed in range(seeds)], 'loss %g, %d'.__mod__):
        robot, dropped = over_steps(loss, run.seed + seed, Greedy())
        if not seed:
            table.write(run.folder / ('course_%g.csv' % loss), in_bins(robot, len(STEPS) * EACH))
        streams = navigation()
        with_streams, _ = over_steps(loss, run.seed + seed, streams)
        for number, rate in enumerate(STEPS):
            rows.append({'loss': loss, 'seed': seed, 'step': number, 'rate': rate, 'dropped': dropped[number],
                         **judged(robot, number), 'used_streams': judged(with_streams, number)['used'],
                         **judged_streams(with_streams, streams, number)})
    table.write(run.folder / 'steps.csv', rows)
    rows, losses = [], []
    crowds = {1: 20.0, 10: 20.0} if run.quick else CROWDS
    for robots, seconds in run.steps(crowds.items(), '%d robots, %g s'.__mod__):
        more, counts = crowd(robots, seconds, run.seed)
        rows += more
        losses.append({'robots': robots, 'dropped': counts.dropped / counts.offered})
    table.write(run.folder / 'crowds.csv', rows)
    table.write(run.folder / 'dropped.csv', losses)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Figures over time, and tables of the steps and of the hard links."""
    return [_draw_steps(folder), steps_table(folder), _draw_crowds(folder), scenario_results.results(folder)]


def missed(folder: pathlib.Path) -> List[str]:
    """Goals that were missed."""
    return scenario_results.missed(folder)


def steps_table(folder: pathlib.Path) -> Table:
    """What was measured after each step of the link."""
    steps = table.read(folder / 'steps.csv')
    return Table('From %g s after each step, %d runs each: the median, and the worst in brackets. Required: 85 %% '
                 'used, at most 60 ms of queue, nothing dropped, 2 images a second, and for protected streams the '
                 'link\'s loss, and an age of 80 ms at most:' % (SETTLED, len({row['seed'] for row in steps})),
                 ['loss', 'Mbit/s', 'used', 'queue p95 [ms]', 'dropped', 'used by streams', 'protected lost',
                  'protected age p99 [ms]', 'images [Hz]'],
                 [_row(steps, loss, number) for loss in LOSSES for number in range(len(STEPS))])


DOC_TABLES = {'steps': steps_table, 'scenarios': scenario_results.doc_results}


def _row(steps: List[Dict[str, Any]], loss: float, number: int) -> List[str]:
    """The row of one loss and step: each cell has the median and the worst value."""
    chosen = [row for row in steps if row['loss'] == loss and row['step'] == number]

    def cell(what: str, worst: Callable[[List[float]], float], text: str, scale: float = 1.0) -> str:
        values = [scale * row[what] for row in chosen]
        return '%s (%s)' % (text % np.median(values), text % worst(values))
    return ['%g %%' % (100 * loss), '%g' % STEPS[number], cell('used', min, '%.0f %%', 100),
            cell('queue_p95', max, '%.0f'), cell('dropped', max, '%.0f'), cell('used_streams', min, '%.0f %%', 100),
            cell('protected_lost', max, '%.1f %%', 100), cell('protected_p99', max, '%.0f'),
            cell('pictures', min, '%.1f')]


def _draw_steps(folder: pathlib.Path) -> Figure:
    figure, axes = drawing.canvas(9.0, 7.0, 2 * len(LOSSES), 1, sharex=True, gridspec_kw={
        'height_ratios': (2, 1) * len(LOSSES)})
    edges = EACH * np.arange(len(STEPS) + 1)
    for loss, rates, waits in zip(LOSSES, axes[::2], axes[1::2]):
        rows = table.read(folder / ('course_%g.csv' % loss))
        times = [row['time'] for row in rows]
        rates.stairs(STEPS, edges, color='black', label='link', baseline=None)
        rates.plot(times, [row['sent'] for row in rows], color=drawing.OURS, linewidth=0.9, label='sent')
        rates.set(yscale='log', ylim=(0.05, 60), ylabel='Mbit/s', title='%g %% lost' % (100 * loss))
        waits.plot(times, [row['wait'] for row in rows], color=drawing.OURS, linewidth=0.9)
        waits.axhline(60, color='black', linewidth=0.8, linestyle=':')
        waits.set(ylim=(0, 210), ylabel='queue [ms]')
    axes[0].legend(loc='lower left', ncol=2)
    axes[-1].set(xlabel='time [s]', xlim=(0, edges[-1]))
    drawing.save(figure, folder / 'course.png')
    return Figure('course.png', 'What the link carries and what is sent, over %g s, and the longest wait in its queue. '
                  'The dotted line is the limit once the rate has settled.' % BIN)


def _draw_crowds(folder: pathlib.Path) -> Figure:
    rows = table.read(folder / 'crowds.csv')
    figure, axes = drawing.canvas(9.0, 6.5, 3, 1, sharex=True)
    for robots in sorted({row['robots'] for row in rows}):
        own = [row for row in rows if row['robots'] == robots]
        for axis, what in zip(axes, ('used', 'jain', 'wait')):
            axis.plot([row['second'] for row in own], [row[what] for row in own],
                      label='%d robot%s' % (robots, 's' * (robots > 1)))
    axes[0].set(ylabel='share used', ylim=(0, 1.1))
    axes[1].set(ylabel="Jain's index", ylim=(0, 1.05))
    axes[2].set(ylabel='queue p95 [ms]', ylim=(0, 210), xlabel='time [s]')
    axes[0].legend(loc='lower right', ncol=3)
    drawing.save(figure, folder / 'crowds.png')
    lost = ', '.join('%.1f %% with %d' % (100 * row['dropped'], row['robots'])
                     for row in table.read(folder / 'dropped.csv'))
    return Figure('crowds.png', 'Robots that share %g Mbit/s and start within 5 s: utilisation, fairness, and queueing '
                  'delay. The full queue dropped %s.' % (SHARED, lost))
