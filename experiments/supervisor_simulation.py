# SPDX-License-Identifier: BSD-3-Clause
"""The bandwidth supervisor over simulated links: a link that steps, and an air that many robots share."""
import random
from dataclasses import replace

import numpy as np

from smokebot_udp.link_lab.channel import Channel, Quality
from smokebot_udp.link_lab.simulated import Events, Robot, greedy
from smokebot_udp.link_lab.simulated_streams import navigation

from . import drawing, table
from .runner import Figure, Table, again

TITLE = 'The bandwidth supervisor, simulated'

EXPLANATION = """
What is sent is to follow what the link carries. Here the package's own code for it (the receiver's reports, the
estimate, the division among the streams, the pace) runs over the link lab's channel, event by event and faster than
real time: datagrams have sizes and times, and no pixels.

**A link that steps**, 20 → 5 → 1 → 0.3 → 20 Mbit/s with a delay of 20 ms, a queue of 200 ms, and 0, 5 or 20 % of the
datagrams lost at random, those of the reports, too. First with a sender that always has more, which shows the estimate
alone; then with a robot's streams, which can be turned down only in steps, and with what is protected (tf, odometry,
gas, battery).

**An air that is shared**: 1, 10 and 100 robots, which start within five seconds and always have more to send, over one
queue of 20 Mbit/s. Nothing but the queue's delay tells them of each other. Jain's index is 1 where all get the same,
and 1/n where one gets all.
"""

STEPS = 20, 5, 1, 0.3, 20
EACH, SETTLED = 10.0, 2.0
"""A step lasts so long, and is judged from then on [s]."""

LOSSES = 0.0, 0.05, 0.2
SEEDS = 10
DELAY, QUEUE = 0.02, 0.2
SHARED = 20.0
"""[Mbit/s]"""

CROWDS = {1: 40.0, 10: 40.0, 100: 25.0}
"""{robots: simulated for so long [s]}"""

BIN = 0.1
"""Rates and queues are drawn over so long [s]."""


def channels(rate, loss, seed):
    """(there, back)"""
    return (Channel(Quality(rate=rate * 1e6, loss=loss, delay=DELAY, queue=QUEUE), seed),
            Channel(Quality(loss=loss, delay=DELAY), seed + 1000))


def over_steps(loss, seed, load):
    """(the Robot, [datagrams that the queue dropped after a step's first second, ...])"""
    events, dropped = Events(), []
    there, back = channels(STEPS[0], loss, seed)
    robot = Robot(events, there, back, load, seed)
    for number, rate in enumerate(STEPS):
        there.quality = replace(there.quality, rate=rate * 1e6)
        events.run(number * EACH + 1)
        before = there.counts.dropped
        events.run((number + 1) * EACH)
        dropped.append(there.counts.dropped - before)
    return robot, dropped


def judged(robot, number):
    """{what: value} of one step, from when it has settled on."""
    since, until = number * EACH + SETTLED, (number + 1) * EACH
    sent = np.array(robot.sent)
    sent = sent[(sent[:, 0] >= since) & (sent[:, 0] < until)]
    return {'used': sent[:, 1].sum() * 8e-6 / (until - since) / STEPS[number],
            'queue_p95': 1e3 * np.percentile(sent[:, 2], 95)}


def judged_streams(robot, streams, number):
    """{what: value} of one step with a robot's streams."""
    since, until = number * EACH + SETTLED, (number + 1) * EACH
    ages = [when - left for when, name, _, _, left in robot.came if name in streams.protected and since <= left < until]
    pictures = {frame for when, name, frame, _, _ in robot.came if name == 'thermal' and since <= when < until}
    left = sum(int(until * rate) - int(since * rate) for rate, _ in streams.protected.values())
    return {'protected_lost': max(0.0, 1 - len(ages) / left), 'protected_p99': 1e3 * np.percentile(ages, 99),
            'pictures': len(pictures) / (until - since)}


def in_bins(robot, until):
    """Rows of what was sent [Mbit/s], and of the longest wait [ms], for each BIN."""
    sent = np.array(robot.sent)
    bins = (sent[:, 0] / BIN).astype(int)
    rate, wait = np.bincount(bins, sent[:, 1], int(until / BIN)) * 8e-6 / BIN, np.zeros(int(until / BIN) + 1)
    np.maximum.at(wait, bins, sent[:, 2])
    return [{'time': BIN * at, 'sent': rate[at], 'wait': 1e3 * wait[at]} for at in range(int(until / BIN))]


def crowd(robots, seconds, seed):
    """One air for so many: rows of what all used, how fairly, and the queue, for each second."""
    events, draw = Events(), random.Random(seed)
    there, back = channels(SHARED, 0.0, seed)
    all_ = [Robot(events, there, back, lambda robot: events.at(draw.uniform(0, 5), greedy, robot), 1000 * seed + number)
            for number in range(robots)]
    events.run(seconds)
    bytes_, waits = np.zeros((robots, int(seconds))), [[] for _ in range(int(seconds))]
    for number, robot in enumerate(all_):
        for when, size, wait in robot.sent:
            if when < seconds:
                bytes_[number, int(when)] += size * (wait <= QUEUE)     # what waits longer is dropped
                waits[int(when)].append(wait)
    rows = []
    for second in range(2, int(seconds)):
        got = bytes_[:, second - 2:second + 1].sum(axis=1)      # over three seconds: datagrams are few
        rows.append({'robots': robots, 'second': second, 'used': got.sum() * 8e-6 / 3 / SHARED,
                     'jain': got.sum() ** 2 / (robots * (got ** 2).sum()),
                     'wait': 1e3 * np.percentile(waits[second], 95)})
    return rows, there.counts


def run(run):
    """Write steps.csv, course_LOSS.csv, crowds.csv and dropped.csv."""
    seeds = 3 if run.quick else SEEDS
    rows = []
    for loss, seed in run.steps([(loss, seed) for loss in LOSSES for seed in range(seeds)], say='loss %g, %d'.__mod__):
        robot, dropped = over_steps(loss, run.seed + seed, greedy)
        if not seed:
            table.write(run.folder / ('course_%g.csv' % loss), in_bins(robot, len(STEPS) * EACH))
        streams = navigation()
        with_streams, _ = over_steps(loss, run.seed + seed, streams)
        for number, rate in enumerate(STEPS):
            rows.append({'loss': loss, 'seed': seed, 'step': number, 'rate': rate, 'dropped': dropped[number],
                         **judged(robot, number), 'used_streams': judged(with_streams, number)['used'],
                         **judged_streams(with_streams, streams, number)})
    table.write(run.folder / 'steps.csv', rows)
    rows, dropped = [], []
    crowds = {1: 20.0, 10: 20.0} if run.quick else CROWDS
    for robots, seconds in run.steps(crowds.items(), say='%d robots, %g s'.__mod__):
        more, counts = crowd(robots, seconds, run.seed)
        rows += more
        dropped.append({'robots': robots, 'dropped': counts.dropped / counts.offered})
    table.write(run.folder / 'crowds.csv', rows)
    table.write(run.folder / 'dropped.csv', dropped)


def plot(folder):
    steps = table.read(folder / 'steps.csv')
    rows = [_row(steps, loss, number) for loss in LOSSES for number in range(len(STEPS))]
    return [
        _draw_course(folder),
        Table('From %g s after each step, %d runs each: the median, and the worst in brackets. Asked for: 85 %% used, '
              'at most 60 ms of queue, nothing dropped, 2 pictures a second, and of what is protected the link\'s '
              'loss, and an age of 80 ms at most' % (SETTLED, len({row['seed'] for row in steps})),
              ['loss', 'Mbit/s', 'used', 'queue p95 [ms]', 'dropped', 'used by streams', 'protected lost',
               'protected age p99 [ms]', 'pictures [Hz]'], rows),
        _draw_crowds(folder),
    ]


def _row(steps, loss, number):
    """Of one loss and step: medians and the worst."""
    chosen = [row for row in steps if row['loss'] == loss and row['step'] == number]

    def tell(what, worst, text, scale=1.0):
        values = [scale * row[what] for row in chosen]
        return '%s (%s)' % (text % np.median(values), text % worst(values))
    return ['%g %%' % (100 * loss), '%g' % STEPS[number], tell('used', min, '%.0f %%', 100),
            tell('queue_p95', max, '%.0f'), tell('dropped', max, '%.0f'), tell('used_streams', min, '%.0f %%', 100),
            tell('protected_lost', max, '%.1f %%', 100), tell('protected_p99', max, '%.0f'),
            tell('pictures', min, '%.1f')]


def _draw_course(folder):
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
    return Figure('course.png', 'What the link carries and what is sent, over %g s, and the longest wait in its queue: '
                  'the dotted line is what is allowed where it has settled.' % BIN)


def _draw_crowds(folder):
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
    return Figure('crowds.png', 'Robots that share %g Mbit/s and start within 5 s: what they use together, how fairly, '
                  'and how long datagrams queue. The full queue dropped %s.' % (SHARED, lost))


again(__name__, plot)
