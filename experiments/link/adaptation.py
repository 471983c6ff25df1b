# SPDX-License-Identifier: BSD-3-Clause
"""What is sent follows what the link carries: over a link that steps from 20 to 0.3 Mbit/s and back."""
import bisect
import os
import pathlib
import subprocess
import time
from typing import Any, Callable, Dict, Iterator, List, Mapping, Sequence, Union

import numpy as np
from matplotlib.ticker import StrMethodFormatter

from evaluation import rate_steps, recorder
from evaluation.rate_steps import METHODS, Counts, DisplayHistory, Method, RateStepRun, Step
from smokebot_udp.arrays import Array
from smokebot_udp.link_lab.lab import environment

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Adapting to the link'

EXPLANATION = """
The data of the simulated robot (thermal images of 320 x 240 pixels and 16 bits and colour ones of the same size, both
at 10 Hz, clouds, map, scans, transforms, odometry) cross a link that carries 20, 5, 1, 0.3 and again 20 Mbit/s, in both
directions, with 20 ms of delay each way and a queue of 200 ms, without loss and with random loss. Six methods, one at a
time: this package with a rate that follows the link, images interleaved (raw pixels); the same with images *layered*,
that is compressed and protected; interleaved images at a fixed rate, as the deliverable has it, set for the link at its
best; and everything *whole*, one message each, as ROS sends it: images as JPEG of quality 80, clouds decimated to 0.1
m, odometry and transforms at 10 Hz, over UDPROS, and over TCPROS with cubic and with bbr.

*Used* is the share of its capacity that the air carried, *queue* how long packets waited for the air; the emulated link
itself counts both, from 2 s after a step to its end. *Dropped* are packets that found the queue full, from 1 s after a
step on. Quality compares what is on the operator's display at each instant with what the camera sees at that instant,
in 256 grey levels from 23 to 43 degC, so that age costs quality, too. All these processes share one small machine:
*late* is how late the emulated link was itself (p99 of each quarter of a second, their median), *load* the machine's.
"""

OURS, LAYERED = 'ours, adapting', 'ours, layered'
LOSSES, SECONDS = (0.0, 0.05, 0.2), 6.0
QUICK_LOSSES, QUICK_SECONDS = (0.05,), 5.0
SHOWN_LOSS = 0.05

COLOURS = {OURS: drawing.OURS, LAYERED: drawing.LAYERED, 'ours, fixed at 20 Mbit/s': drawing.PAPER,
           'whole, over UDPROS': '#2ca02c', 'whole, over TCPROS, cubic': '#1f77b4',
           'whole, over TCPROS, bbr': '#17becf'}

FILM_TIME = 4.5
"""When the film strip has an image, after each step [s]."""

OTHERS = {'cloud': 'operator/lidar/points', 'scan': 'operator/scan'}

SWITCH_RATE, SWITCH_LOSS = 1e6, 0.05
BEFORE, AFTER = 'inspection', 'mapping'
SETTLE, WATCHED = 8.0, 6.0
"""How long a focus is held before and after it is switched [s]."""


def run(run: Run) -> None:
    """Write steps.csv, times.csv, film.npz, whole.csv and switch.csv."""
    losses, seconds = (QUICK_LOSSES, QUICK_SECONDS) if run.quick else (LOSSES, SECONDS)
    rows: List[table.Row] = []
    times: List[table.Row] = []
    film = {}
    for name in run.steps(METHODS, str):
        with RateStepRun(METHODS[name], run.seed, run.folder) as link:
            for loss in losses:
                steps = link.measure_in_time(loss, seconds)
                display = DisplayHistory(link)
                case = {'way': name, 'loss [%]': 100 * loss}
                measured = list(step_rows(link, steps, display))
                check_heard(measured)
                rows += [{**case, **row} for row in measured]
                times += [{**case, **row} for row in time_rows(link, steps, display)]
                table.write(run.folder / 'steps.csv', rows)
                table.write(run.folder / 'times.csv', times)
                if loss == SHOWN_LOSS:
                    film[name] = film_strip(steps, display)
    np.savez_compressed(str(run.folder / 'film.npz'), **film)
    measure_without_camera(run, seconds)
    measure_switch(run)


def check_heard(rows: Sequence[table.Row]) -> None:
    """Check that the protected topics of one run were heard on the robot's side.

    :raises RuntimeError: where a protected topic was never heard on the robot's side, so that nothing can be judged
    """
    for name in (rate_steps.ODOM, rate_steps.TF):
        if not any(row[name + ' left'] for row in rows):
            raise RuntimeError('nothing of %s was heard leaving: see nodes.log' % name)


def step_rows(link: RateStepRun, steps: Sequence[Step], display: DisplayHistory) -> Iterator[table.Row]:
    """Rows of steps.csv."""
    sent, arrived = list(link.robot.heard), list(link.operator.heard)
    for number, step in enumerate(steps):
        protected = {'%s %s' % (name, key): value for name, topics in link.method.protected.items()
                     for key, value in rate_steps.message_row(sent, arrived, step, topics).items()}
        yield {'step': number, 'rate [Mbit/s]': step.rate / 1e6, **rate_steps.link_row(step), **protected,
               **display.row(step.begun + rate_steps.STEADY, step.ended), 'load': round(os.getloadavg()[0], 1)}


def time_rows(link: RateStepRun, steps: Sequence[Step], display: DisplayHistory) -> Iterator[table.Row]:
    """Rows of times.csv, one for each sample of the link's counts."""
    begun = steps[0].begun
    statuses = [heard for heard in link.operator.heard if heard.topic == 'operator/link']
    arrivals = [heard.arrival for heard in statuses]
    for step in steps:
        for (before, a), (now, b) in zip(step.counts, step.counts[1:]):
            last = bisect.bisect(arrivals, now) - 1
            age, quality = display.age(now), display.psnr(now)
            yield {'time [s]': round(now - begun, 2), 'capacity [Mbit/s]': step.rate / 1e6,
                   'carried [Mbit/s]': round(8e-6 * growth(a, b, 'carried') / (now - before), 3),
                   'queue p95 [ms]': rate_steps.queue_delay(a, b, 0.95), 'dropped': growth(a, b, 'dropped'),
                   'told [Mbit/s]': round(statuses[last].amount['rate'], 3) if last >= 0 else None,
                   'age [s]': None if age is None else round(age, 3),
                   'PSNR [dB]': None if quality is None else round(quality, 2)}


def growth(before: Counts, after: Counts, key: str) -> int:
    """Growth of a count of what the robot sent, from `before` to `after`."""
    return int(after['robot'][key] - before['robot'][key])


def film_strip(steps: Sequence[Step], display: DisplayHistory) -> Array:
    """What the camera saw, and what the operator saw, FILM_TIME after each of n steps.

    :return: (2, n, height, width) uint8
    """
    instants = [step.begun + FILM_TIME for step in steps]
    black = np.zeros((recorder.HEIGHT, recorder.WIDTH), np.uint16)
    shown = [display.shown(when) for when in instants]
    return np.array([[recorder.to_grey(display.truth(when)) for when in instants],
                     [recorder.to_grey(black if image is None else image) for image in shown]])


def measure_without_camera(run: Run, seconds: float) -> None:
    """Write whole.csv: all but the colour camera over 20 Mbit/s, which is room enough."""
    method = Method([*(METHODS[OURS].robot or ()), '_camera/enabled:=false'])
    with RateStepRun(method, run.seed, run.folder) as link:
        time.sleep(SETTLE)
        step, = link.measure(0.0, 2 * seconds, rate_steps.RATES[:1])
        row, = step_rows(link, [step], DisplayHistory(link))
        since = step.begun + rate_steps.STEADY
        heard = [heard.topic for heard in link.operator.heard if since <= heard.arrival < step.ended]
        rates = {'%s [Hz]' % name: round(heard.count(topic) / (step.ended - since), 2)
                 for name, topic in OTHERS.items()}
    table.write(run.folder / 'whole.csv', [{**row, **rates, 'maps': heard.count('operator/map')}])


def measure_switch(run: Run) -> None:
    """Write switch.csv: the rate of each stream around a switch of the focus."""
    with RateStepRun(METHODS[OURS], run.seed, run.folder) as link:
        link.set_link(SWITCH_RATE, SWITCH_LOSS)
        set_focus(link, BEFORE)
        time.sleep(SETTLE)
        set_focus(link, AFTER)
        time.sleep(WATCHED + 1.0)
        switched = next(heard.arrival for heard in link.robot.heard if heard.topic == 'robot_sender/status'
                        and heard.amount[0] == AFTER)
        reports = [(heard.arrival - switched, heard.amount) for heard in link.operator.heard
                   if heard.topic == rate_steps.REPORT and abs(heard.arrival - switched) < WATCHED]
    rows = [{'time [s]': round(now, 3), 'stream': name,
             'rate [kbit/s]': round(8e-3 * (count - a.get(name, 0)) / (now - then), 1)}
            for (then, a), (now, b) in zip(reports[::2], reports[2::2]) for name, count in b.items()]
    table.write(run.folder / 'switch.csv', rows)


def set_focus(link: RateStepRun, focus: str) -> None:
    """Switch the mission focus, on the robot's side."""
    link.stack.lab.run('robot', ['rosservice', 'call', '/robot_sender/set_focus', focus], check=True, timeout=60,
                       env=environment('robot'), stdout=subprocess.DEVNULL)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Figures over time, and tables of each loss, of all methods, and of the switch."""
    rows, times = table.read(folder / 'steps.csv'), table.read(folder / 'times.csv')
    losses = sorted({row['loss [%]'] for row in rows})
    shown = 100 * SHOWN_LOSS if 100 * SHOWN_LOSS in losses else losses[0]
    draw_times([row for row in times if row['loss [%]'] == shown], folder / 'adaptation.png')
    draw_film(np.load(str(folder / 'film.npz')), folder / 'film.png')
    items: List[Union[Figure, Table]] = [
        Figure('adaptation.png', 'At a loss of %g %%. From the top: what the link could carry (black) and what it '
               'carried; how long packets waited for the air; the quality of the image on the display, compared with '
               'what the camera sees then; and its age.' % shown),
        Figure('film.png', 'At a loss of %g %%: left what the camera sees, right what is on the operator\'s display at '
               'that instant, %g s after each step of the link.' % (shown, FILM_TIME))]
    items += [goals_table(rows, OURS), goals_table(rows, LAYERED)]
    items += simulation_tables(folder, rows)
    links = ['%g Mbit/s, %g %%' % (row['rate [Mbit/s]'], row['loss [%]']) for row in rows if row['way'] == OURS]
    for key, caption in COMPARED.items():
        items.append(Table(caption, ['method', *links],
                           [[method, *(row[key] for row in rows if row['way'] == method)] for method in METHODS]))
    items.append(without_camera_table(folder))
    switched = table.read(folder / 'switch.csv')
    draw_switch(switched, folder / 'switch.png')
    caption = 'The focus is switched from %s to %s at 0 s, over %g Mbit/s with a loss of %g %%.' % (
        BEFORE, AFTER, SWITCH_RATE / 1e6, 100 * SWITCH_LOSS)
    return [*items, Figure('switch.png', caption), switch_table(switched)]


COLUMNS = {'lost [%]': 'loss [%]', 'Mbit/s': 'rate [Mbit/s]', 'used [%]': 'used [%]',
           'queue p50 [ms]': 'queue p50 [ms]', 'p95 [ms]': 'queue p95 [ms]', 'dropped': 'dropped',
           'air lost [%]': 'air lost [%]', 'odom lost [%]': 'odom lost [%]', 'age p99 [ms]': 'odom age p99 [ms]',
           'tf lost [%]': 'tf lost [%]', 'tf age p99 [ms]': 'tf age p99 [ms]', 'images [Hz]': 'pictures [Hz]',
           'exact [%]': 'exact [%]', 'image age p50 [ms]': 'age p50 [ms]', 'image p99 [ms]': 'age p99 [ms]',
           'PSNR [dB]': 'PSNR [dB]', 'late [ms]': 'late p99 [ms]', 'load': 'load'}
"""{column of the report: column of steps.csv}"""

COMPARED = {'pictures [Hz]': 'Images per second, from 2 s after each step.',
            'age p50 [ms]': 'The age of images when they arrive, median [ms].',
            'age p99 [ms]': 'The same, 99th percentile [ms].',
            'PSNR [dB]': 'The quality of what is on the display, compared with what the camera sees, mean PSNR [dB].',
            'queue p95 [ms]': 'How long packets waited for the air, p95 [ms].',
            'dropped': 'Packets that found the queue full, from 1 s after each step.',
            'odom age p99 [ms]': 'The age of odometry when it arrives, p99 [ms].'}
"""{column of steps.csv: caption of a table of all methods}"""


def goals_table(rows: Sequence[table.Row], method: str) -> Table:
    """All that was measured of one of our methods."""
    return Table('%s. The goals: used from 85 %%, queue up to 60 ms, none dropped, odom and tf lost as the air loses, '
                 'and 80 ms old at p99.' % method.capitalize(), list(COLUMNS),
                 [[row[key] for key in COLUMNS.values()] for row in rows if row['way'] == method])


def without_camera_table(folder: pathlib.Path) -> Table:
    """What a link with room enough carries."""
    row, = table.read(folder / 'whole.csv')
    shown = {words: key for words, key in COLUMNS.items() if key in row}
    return Table('All but the colour camera over %g Mbit/s, images interleaved:' % row['rate [Mbit/s]'],
                 [*shown, *('%s [Hz]' % name for name in OTHERS), 'maps'],
                 [[*(row[key] for key in shown.values()), *(row['%s [Hz]' % name] for name in OTHERS), row['maps']]])


def compared_table(folder: pathlib.Path) -> Table:
    """All methods at SHOWN_LOSS, by what a crew asks for."""
    rows = [row for row in table.read(folder / 'steps.csv') if row['loss [%]'] == 100 * SHOWN_LOSS]

    def text(row: table.Row, key: str) -> str:
        return '–' if row[key] is None else '%.3g' % row[key] if row[key] < 1000 else '%.0f' % row[key]
    return Table('All methods at %g %% packet loss, from %g s after each step of the link; –: nothing arrived.'
                 % (100 * SHOWN_LOSS, rate_steps.STEADY),
                 ['', 'method', *('%g Mbit/s' % (rate / 1e6) for rate in rate_steps.RATES)], [
                     [words, method, *(text(row, key) for row in rows if row['way'] == method)]
                     for key, words in DOC_COMPARED.items() for method in METHODS])


DOC_COMPARED = {'pictures [Hz]': 'images per second', 'age p50 [ms]': 'age of images, p50 [ms]',
                'PSNR [dB]': 'screen against what the camera sees then [dB]', 'odom lost [%]': 'odometry lost [%]',
                'odom age p99 [ms]': 'age of odometry, p99 [ms]'}
"""{column of steps.csv: words of the doc's table}"""


def _doc_goals(method: str) -> Callable[[pathlib.Path], Table]:
    return lambda folder: goals_table(table.read(folder / 'steps.csv'), method)


def simulation_tables(folder: pathlib.Path, rows: Sequence[table.Row]) -> List[Union[Figure, Table]]:
    """A table beside the results of supervisor_simulation for the same steps; empty where there are none."""
    path = folder.parent / 'supervisor_simulation' / 'steps.csv'
    if not path.exists():
        return []
    simulated, lines = table.read(path), []
    for row in rows:
        same = [one for one in simulated if (100 * one['loss'], one['step']) == (row['loss [%]'], row['step'])]
        if row['way'] == OURS and same:
            used, age, images = (float(np.median([one[key] for one in same]))
                                 for key in ('used_streams', 'protected_p99', 'pictures'))
            lines.append(['%g Mbit/s, %g %%' % (row['rate [Mbit/s]'], row['loss [%]']), row['used [%]'],
                          round(100 * used, 1), row['odom age p99 [ms]'], round(age), row['pictures [Hz]'],
                          round(images, 1)])
    return [Table('The lab beside the simulation (supervisor_simulation; medians of its runs).', [
        'link', 'used [%]', 'simulated', 'odom age p99 [ms]', 'protected, simulated', 'images [Hz]', 'simulated'],
        lines)]


def draw_times(rows: Sequence[table.Row], path: pathlib.Path) -> None:
    """The link and the display over time, with all methods."""
    figure, axes = drawing.canvas(10, 9, rows=4, sharex=True)
    panels = ('carried [Mbit/s]', 'queue p95 [ms]', 'PSNR [dB]', 'age [s]')
    for method in METHODS:
        mine = [row for row in rows if row['way'] == method]
        for ax, key in zip(axes, panels):
            ax.plot([row['time [s]'] for row in mine], [np.nan if row[key] is None else row[key] for row in mine],
                    color=COLOURS[method], label=method, linewidth=1.4, zorder=3 if method in (OURS, LAYERED) else 2)
            ax.set_ylabel(key)
    ours = [row for row in rows if row['way'] == OURS]
    axes[0].step([row['time [s]'] for row in ours], [row['capacity [Mbit/s]'] for row in ours], where='pre',
                 color='black', linestyle=':', label='the link')
    axes[0].set_yscale('log')
    axes[3].set(yscale='log', xlabel='time [s]')
    for ax in (axes[0], axes[3]):
        ax.yaxis.set_major_formatter(StrMethodFormatter('{x:g}'))
    drawing.legend_right(axes[0])
    drawing.save(figure, path)


def draw_film(film: Mapping[str, Array], path: pathlib.Path) -> None:
    """Pairs of images: a row for each method, a pair for each step."""
    methods = [method for method in METHODS if method in film]
    count = len(rate_steps.RATES)
    figure, axes = drawing.canvas(3.0 * count, 1.35 * len(methods), rows=len(methods), columns=2 * count,
                                  squeeze=False)
    for row, method in zip(axes, methods):
        for number, pair in enumerate(zip(*film[method])):
            for ax, image in zip(row[2 * number:], pair):
                drawing.show_image(ax, image, vmin=0, vmax=255)
        row[0].set_title(method, fontsize=9, loc='left')
    for number, rate in enumerate(rate_steps.RATES):
        axes[0][2 * number + 1].set_title('%g Mbit/s' % (rate / 1e6), fontsize=9, loc='left')
    drawing.save(figure, path)


def mean_rates(rows: Sequence[table.Row], begun: float, ended: float) -> Dict[str, float]:
    """{stream: its mean rate [kbit/s]} between two times."""
    names = {row['stream'] for row in rows}
    return {name: float(np.mean([row['rate [kbit/s]'] for row in rows if row['stream'] == name
                                 and begun <= row['time [s]'] < ended] or [0.0])) for name in names}


def draw_switch(rows: Sequence[table.Row], path: pathlib.Path) -> None:
    """The rates of the five largest streams around the switch."""
    sizes = mean_rates(rows, -WATCHED, WATCHED)
    figure, ax = drawing.canvas(9, 4)
    for name in sorted(sizes, key=lambda name: -sizes[name])[:5]:
        mine = [row for row in rows if row['stream'] == name]
        ax.step([row['time [s]'] for row in mine], [row['rate [kbit/s]'] for row in mine], where='pre', label=name)
    ax.axvline(0.0, color='black', linestyle=':')
    ax.set(xlabel='time after the switch [s]', ylabel='received [kbit/s]')
    drawing.legend_right(ax)
    drawing.save(figure, path)


def switch_table(rows: Sequence[table.Row]) -> Table:
    """Each stream's share of what arrived."""
    windows = {'before': (-3.0, 0.0), '0 to 0.5 s': (0.0, 0.5), '0.5 to 1.5 s': (0.5, 1.5), '2 to 6 s': (2.0, 6.0)}
    shares: Dict[str, Dict[str, Any]] = {}
    for label, window in windows.items():
        found = mean_rates(rows, *window)
        total = max(1e-9, sum(found.values()))
        shares[label] = {name: round(100 * rate / total, 1) for name, rate in found.items()}
    names = sorted(shares['before'], key=lambda name: -max(share[name] for share in shares.values()))
    return Table('Each stream\'s share of what arrived around the switch [%].', ['stream', *windows],
                 [[name, *(shares[label][name] for label in windows)] for name in names])


def doc_switch(folder: pathlib.Path) -> Table:
    """switch_table of the last results."""
    return switch_table(table.read(folder / 'switch.csv'))


DOC_TABLES = {'adapting': _doc_goals(OURS), 'layered': _doc_goals(LAYERED), 'compared': compared_table,
              'without_camera': without_camera_table, 'switch': doc_switch}
