# SPDX-License-Identifier: BSD-3-Clause
"""What is sent follows what the link carries: over a link that steps from 20 to 0.3 Mbit/s and back."""
import bisect
import os
import time

import numpy as np

from smokebot_udp.link_lab.lab import environment

from . import drawing, keeper, steps, table
from .runner import Figure, Table, again

TITLE = 'Adapting to the link'

EXPLANATION = """
The simulated robot's data (thermal pictures of 320 x 240 pixels and 16 bits and colour ones of the same size, both at
10 Hz, clouds, map, scans, transforms, odometry) cross a link that carries 20, 5, 1, 0.3 and again 20 Mbit/s, both ways,
with 20 ms of delay each way and a queue of 200 ms, without loss and with random loss. Five ways, one at a time: this
package with the rate that follows the link; the same at a fixed rate, as the deliverable has it, set for the link at
its best; and everything whole, one message each, as ROS does it: pictures as JPEG of quality 80, clouds thinned to
0.1 m, odometry and transforms at 10 Hz, over UDPROS, and over TCPROS with cubic and with bbr.

*Used* is what the air carried of what it could, *queue* how long packets waited for it; both told by the emulated link
itself, from 2 s after a step to its end. *Dropped* are packets that found the queue full, from 1 s after a step on.
Quality is that of what is on the operator's screen at each instant, beside what the camera sees at that instant, in
256 greys from 23 to 43 degC, so age costs, too. All these processes share one small machine: *late* tells how late the
emulated link was itself (p99 of each quarter of a second, their median), *load* is the machine's.
"""

OURS = 'ours, adapting'
LOSSES, SECONDS = (0.0, 0.05, 0.2), 6.0
QUICK_LOSSES, QUICK_SECONDS = (0.05,), 5.0
SHOWN_LOSS = 0.05

COLOURS = {OURS: drawing.OURS, 'ours, fixed at 20 Mbit/s': drawing.PAPER, 'whole, over UDPROS': '#2ca02c',
           'whole, over TCPROS, cubic': '#1f77b4', 'whole, over TCPROS, bbr': '#17becf'}

STRIP = 4.5
"""So long after each step the film strip has a picture [s]."""

OTHERS = {'cloud': 'operator/lidar/points', 'scan': 'operator/scan'}

SWITCH_RATE, SWITCH_LOSS = 1e6, 0.05
BEFORE, AFTER = 'inspection', 'mapping'
SETTLE, WATCHED = 8.0, 6.0
"""How long a focus is held before it is switched, and after [s]."""


def run(run):
    losses, seconds = (QUICK_LOSSES, QUICK_SECONDS) if run.quick else (LOSSES, SECONDS)
    rows, times, film = [], [], {}
    for name in run.steps(steps.WAYS, say=str):
        with steps.Across(steps.WAYS[name], run.seed, run.folder) as across:
            for loss in losses:
                walked = steps.walk_in_time(across, loss, seconds)
                screen = steps.Screen(across)
                rows += [{'way': name, 'loss [%]': 100 * loss, **row} for row in of_steps(across, walked, screen)]
                times += [{'way': name, 'loss [%]': 100 * loss, **row} for row in over_time(across, walked, screen)]
                table.write(run.folder / 'steps.csv', rows)
                table.write(run.folder / 'times.csv', times)
                if loss == SHOWN_LOSS:
                    film[name] = strip(walked, screen)
            if across.missed():
                raise RuntimeError('the lab itself lost packets: the machine is too busy')
    np.savez_compressed(str(run.folder / 'film.npz'), **film)
    whole(run, seconds)
    switch(run)


def of_steps(across, walked, screen):
    """Rows of steps.csv."""
    left, came = list(across.robot.heard), list(across.operator.heard)
    for number, step in enumerate(walked):
        protected = {'%s %s' % (name, key): value for name, topics in across.way.protected.items()
                     for key, value in steps.of_messages(left, came, step, topics).items()}
        yield {'step': number, 'rate [Mbit/s]': step.rate / 1e6, **steps.of_link(step), **protected,
               **screen.during(step.begun + steps.STEADY, step.ended), 'load': round(os.getloadavg()[0], 1)}


def over_time(across, walked, screen):
    """Rows of times.csv: each EVERY."""
    begun = walked[0].begun
    links = [heard for heard in across.operator.heard if heard.topic == 'operator/link']
    told = [heard.arrival for heard in links]
    arrivals = [heard.arrival for heard in screen.came]
    for step in walked:
        for (before, a), (now, b) in zip(step.counts, step.counts[1:]):
            last = bisect.bisect(told, now) - 1
            shown = bisect.bisect(arrivals, now) - 1
            quality = screen.psnr(now)
            yield {'time [s]': round(now - begun, 2), 'capacity [Mbit/s]': step.rate / 1e6,
                   'carried [Mbit/s]': round(8e-6 * grown(a, b, 'carried') / (now - before), 3),
                   'queue p95 [ms]': steps.waited(a, b, 0.95), 'dropped': grown(a, b, 'dropped'),
                   'told [Mbit/s]': round(links[last].amount['rate'], 3) if last >= 0 else None,
                   'age [s]': round(now - screen.came[shown].stamp, 3) if shown >= 0 else None,
                   'PSNR [dB]': None if quality is None else round(float(quality), 2)}


def grown(before, after, key):
    return after['robot'][key] - before['robot'][key]


def strip(walked, screen):
    """(2, n, height, width) greys: what the camera saw, and what the operator saw, n times."""
    black = np.zeros((keeper.HEIGHT, keeper.WIDTH), np.uint16)
    instants = [step.begun + STRIP for step in walked]
    pairs = [(screen.true(when), screen.shown(when)) for when in instants]
    return np.stack([[keeper.to_grey(black if picture is None else picture) for picture in pictures]
                     for pictures in zip(*pairs)])


def whole(run, seconds):
    """Write whole.csv: all but the colour camera's pictures over 20 Mbit/s, which is room enough."""
    rows, way = [], steps.Way([*steps.WAYS[OURS].robot, '_camera/enabled:=false'])
    with steps.Across(way, run.seed, run.folder) as across:
        time.sleep(SETTLE)
        step, = steps.walk(across, 0.0, 2 * seconds, steps.RATES[:1])
        row, = of_steps(across, [step], steps.Screen(across))
        since = step.begun + steps.STEADY
        heard = [heard.topic for heard in across.operator.heard if since <= heard.arrival < step.ended]
        rates = {'%s [Hz]' % name: round(heard.count(topic) / (step.ended - since), 2)
                 for name, topic in OTHERS.items()}
        rows.append({**row, **rates, 'maps': heard.count('operator/map')})
    table.write(run.folder / 'whole.csv', rows)


def switch(run):
    """Write switch.csv: what came of each stream around a switch of the focus."""
    with steps.Across(steps.WAYS[OURS], run.seed, run.folder) as across:
        across.link(SWITCH_RATE, SWITCH_LOSS)
        call(across, BEFORE)
        time.sleep(SETTLE)
        call(across, AFTER)
        time.sleep(WATCHED + 1.0)
        switched = next(heard.arrival for heard in across.robot.heard if heard.topic == 'robot_sender/status'
                        and heard.amount[0] == AFTER)
        reports = [(heard.arrival - switched, heard.amount) for heard in across.operator.heard
                   if heard.topic == steps.REPORT and abs(heard.arrival - switched) < WATCHED]
    rows = [{'time [s]': round(now, 3), 'stream': name,
             'rate [kbit/s]': round(8e-3 * (count - a.get(name, 0)) / (now - then), 1)}
            for (then, a), (now, b) in zip(reports[::2], reports[2::2]) for name, count in b.items()]
    table.write(run.folder / 'switch.csv', rows)


def call(across, focus):
    """Switch the mission focus, on the robot's side."""
    across.stack.lab.run('robot', ['rosservice', 'call', '/robot_sender/set_focus', focus], check=True, timeout=60,
                         env=environment('robot'), stdout=-3)


def beside_the_simulation(folder, rows):
    """[Table] of what supervisor_simulation had for the same steps, where that was run, too."""
    path = folder.parent / 'supervisor_simulation' / 'steps.csv'
    if not path.exists():
        return []
    simulated, lines = table.read(path), []
    for row in rows:
        same = [one for one in simulated if (100 * one['loss'], one['step']) == (row['loss [%]'], row['step'])]
        if row['way'] == OURS and same:
            used, age, pictures = (float(np.median([one[key] for one in same]))
                                   for key in ('used_streams', 'protected_p99', 'pictures'))
            lines.append(['%g Mbit/s, %g %%' % (row['rate [Mbit/s]'], row['loss [%]']), row['used [%]'],
                          round(100 * used, 1), row['odom age p99 [ms]'], round(age), row['pictures [Hz]'],
                          round(pictures, 1)])
    return [Table('The lab beside the simulation (supervisor_simulation; medians of its runs).', [
        'link', 'used [%]', 'simulated', 'odom age p99 [ms]', 'protected, simulated', 'pictures [Hz]', 'simulated'],
        lines)]


def plot(folder):
    rows, times = table.read(folder / 'steps.csv'), table.read(folder / 'times.csv')
    losses = sorted({row['loss [%]'] for row in rows})
    shown = 100 * SHOWN_LOSS if 100 * SHOWN_LOSS in losses else losses[0]
    draw_times([row for row in times if row['loss [%]'] == shown], folder / 'adaptation.png')
    draw_film(np.load(str(folder / 'film.npz')), folder / 'film.png')
    items = [Figure('adaptation.png', 'At a loss of %g %%. From above: what the link could carry (black) and what it '
                    'carried; how long packets waited for the air; how good the picture on the screen is, beside what '
                    'the camera sees then; and how old it is.' % shown),
             Figure('film.png', 'At a loss of %g %%: left what the camera sees, right what is on the operator\'s '
                    'screen at that instant, %g s after each step of the link. The robot drives, and is not at one '
                    'place in all ways.' % (shown, STRIP))]
    for loss in losses:
        ours = [row for row in rows if (row['way'], row['loss [%]']) == (OURS, loss)]
        items.append(Table('This package, adapting, at a loss of %g %%. Asked for: used from 85 %%, queue to 60 ms, '
                           'none dropped, odom and tf lost as the air loses, and 80 ms old at p99.' % loss,
                           list(COLUMNS), [[row[key] for key in COLUMNS.values()] for row in ours]))
    items += beside_the_simulation(folder, rows)
    for key, caption in PEERS.items():
        items.append(Table(caption, ['way', *(('%g Mbit/s, %g %%' % (row['rate [Mbit/s]'], row['loss [%]']))
                                              for row in rows if row['way'] == OURS)],
                           [[way, *(row[key] for row in rows if row['way'] == way)] for way in steps.WAYS]))
    exact, = table.read(folder / 'whole.csv')
    items.append(Table('All but the colour camera over 20 Mbit/s.', list(exact), [list(exact.values())]))
    switched = table.read(folder / 'switch.csv')
    draw_switch(switched, folder / 'switch.png')
    caption = 'The focus is switched from %s to %s at 0 s, over %g Mbit/s with a loss of %g %%.' % (
        BEFORE, AFTER, SWITCH_RATE / 1e6, 100 * SWITCH_LOSS)
    return [*items, Figure('switch.png', caption), of_switch(switched)]


COLUMNS = {'Mbit/s': 'rate [Mbit/s]', 'used [%]': 'used [%]', 'queue p50 [ms]': 'queue p50 [ms]',
           'p95 [ms]': 'queue p95 [ms]', 'dropped': 'dropped', 'air lost [%]': 'air lost [%]',
           'odom lost [%]': 'odom lost [%]', 'age p99 [ms]': 'odom age p99 [ms]', 'tf lost [%]': 'tf lost [%]',
           'tf age p99 [ms]': 'tf age p99 [ms]', 'pictures [Hz]': 'pictures [Hz]', 'exact [%]': 'exact [%]',
           'picture age p50 [ms]': 'age p50 [ms]', 'picture p99 [ms]': 'age p99 [ms]', 'PSNR [dB]': 'PSNR [dB]',
           'late [ms]': 'late p99 [ms]', 'load': 'load'}
"""{in the report: in steps.csv}"""

PEERS = {'pictures [Hz]': 'Pictures a second, from 2 s after each step.',
         'age p50 [ms]': 'The age of pictures when they come, median [ms].',
         'age p99 [ms]': 'The same, of a hundred the oldest but one [ms].',
         'PSNR [dB]': 'What is on the screen beside what the camera sees, mean PSNR [dB].',
         'queue p95 [ms]': 'How long packets waited for the air, p95 [ms].',
         'dropped': 'Packets that found the queue full, from 1 s after each step.',
         'odom age p99 [ms]': 'The age of odometry when it comes, p99 [ms].'}


def draw_times(rows, path):
    figure, axes = drawing.canvas(10, 9, rows=4, sharex=True)
    panels = ('carried [Mbit/s]', 'queue p95 [ms]', 'PSNR [dB]', 'age [s]')
    for way in steps.WAYS:
        mine = [row for row in rows if row['way'] == way]
        for ax, key in zip(axes, panels):
            ax.plot([row['time [s]'] for row in mine], [np.nan if row[key] is None else row[key] for row in mine],
                    color=COLOURS[way], label=way, linewidth=1.4, zorder=3 if way == OURS else 2)
            ax.set_ylabel(key)
    first = [row for row in rows if row['way'] == OURS]
    axes[0].step([row['time [s]'] for row in first], [row['capacity [Mbit/s]'] for row in first], where='pre',
                 color='black', linestyle=':', label='the link')
    axes[0].set_yscale('log')
    axes[3].set(yscale='log', xlabel='time [s]')
    for ax in (axes[0], axes[3]):
        ax.yaxis.set_major_formatter('{x:g}')
    axes[0].legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    drawing.save(figure, path)


def draw_film(film, path):
    ways = [way for way in steps.WAYS if way in film]
    figure, axes = drawing.canvas(3.0 * len(steps.RATES), 1.35 * len(ways), rows=len(ways),
                                  columns=2 * len(steps.RATES), squeeze=False)
    for row, way in zip(axes, ways):
        for number, pictures in enumerate(zip(*film[way])):
            for ax, picture in zip(row[2 * number:], pictures):
                drawing.picture(ax, picture, vmin=0, vmax=255)
        row[0].set_title(way, fontsize=9, loc='left')
    for number, rate in enumerate(steps.RATES):
        axes[0][2 * number + 1].set_title('%g Mbit/s' % (rate / 1e6), fontsize=9, loc='left')
    drawing.save(figure, path)


def rates(rows, begun, ended):
    """{stream: its mean rate [kbit/s]} between two times."""
    names = {row['stream'] for row in rows}
    return {name: float(np.mean([row['rate [kbit/s]'] for row in rows if row['stream'] == name
                                 and begun <= row['time [s]'] < ended] or [0.0])) for name in names}


def draw_switch(rows, path):
    sizes = rates(rows, -WATCHED, WATCHED)
    names = sorted(sizes, key=sizes.get)[-5:][::-1]
    figure, ax = drawing.canvas(9, 4)
    for name in names:
        mine = [row for row in rows if row['stream'] == name]
        ax.step([row['time [s]'] for row in mine], [row['rate [kbit/s]'] for row in mine], where='pre', label=name)
    ax.axvline(0.0, color='black', linestyle=':')
    ax.set(xlabel='time after the switch [s]', ylabel='came [kbit/s]')
    ax.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    drawing.save(figure, path)


def of_switch(rows):
    """A Table of each stream's share of what came."""
    windows = {'before': (-3.0, 0.0), '0 to 0.5 s': (0.0, 0.5), '0.5 to 1.5 s': (0.5, 1.5), '2 to 6 s': (2.0, 6.0)}
    shares = {}
    for label, window in windows.items():
        found = rates(rows, *window)
        shares[label] = {name: round(100 * rate / max(1e-9, sum(found.values())), 1) for name, rate in found.items()}
    names = sorted(shares['before'], key=lambda name: -max(share[name] for share in shares.values()))
    return Table('Each stream\'s share of what came around the switch [%].', ['stream', *windows],
                 [[name, *(shares[label][name] for label in windows)] for name in names])


again(__name__, plot)
