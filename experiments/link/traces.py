# SPDX-License-Identifier: BSD-3-Clause
"""What the operator sees while the link follows a trace, with each method: measured for out_of_range and link_cut."""
import functools
import pathlib
import time
from dataclasses import replace
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

import numpy as np
from matplotlib.ticker import StrMethodFormatter

from evaluation.link_run import IMAGE_METHODS, LOAD_CODEC, LinkRun, Method, repeated
from smokebot_udp.arrays import FloatArray
from smokebot_udp.link_lab import link_trace

from .. import drawing, table
from ..runner import Run

INTERLEAVED = 'smokebot_udp, interleaved'
METHODS = {
    'smokebot_udp': Method('default/image_raw', [['operator/default/image_raw', 'image', 'TCPROS']], LOAD_CODEC),
    INTERLEAVED: Method('camera/image_raw', [['operator/camera/image_raw', 'image', 'TCPROS'],
                                             ['operator/camera/mask', 'mask', 'TCPROS']]),
    'JPEG over TCPROS': IMAGE_METHODS['JPEG over TCPROS'],
    'JPEG over UDPROS': IMAGE_METHODS['JPEG over UDPROS'],
}

CAPTION = ('From the top: the link; how many images arrive; the age of the newest image that the operator has; and '
           'the share of the pixels of each interleaved image that was received rather than filled.')

QUICK_METHODS = 'smokebot_udp', 'JPEG over TCPROS'

WINDOW = 1.0
"""Duration of the window in which images are counted [s]."""

STEP = 0.1
"""Time step of the curves [s]."""


class Images(NamedTuple):
    """The images that arrived with one method, times from the start [s]."""
    stamps: FloatArray
    """(n,)"""
    arrivals: FloatArray
    """(n,)"""
    received: Dict[float, float]
    """{stamp: share of the pixels that was received}; empty: the method has no such share."""


def run(run: Run, trace: str, seconds: float, quick_speed: float) -> None:
    """Follow a trace once with each method; writes messages.csv, link.csv and state.csv.

    :param trace: text of a link.yaml
    :param seconds: its duration
    :param quick_speed: the factor by which a quick run is faster
    """
    speed = quick_speed if run.quick else 1.0
    seconds /= speed
    steps = [replace(step, at=step.at / speed) for step in link_trace.load(trace)[1]]
    rows, states = [], []
    with LinkRun(run.seed, run.folder / 'nodes.log', run.quick, adapt=True) as link:
        for name in run.steps(QUICK_METHODS if run.quick else METHODS, str):
            found, state = repeated(functools.partial(follow, link, name, steps, seconds))
            rows += found
            states.append({'way': name, **state})
    table.write(run.folder / 'messages.csv', rows)
    table.write(run.folder / 'state.csv', states)
    table.write(run.folder / 'link.csv', [{'at [s]': step.at, **vars(step.robot)} for step in steps] +
                [{'at [s]': seconds, **vars(steps[-1].robot)}])


def follow(link: LinkRun, name: str, steps: Sequence[link_trace.Step],
           seconds: float) -> Tuple[List[table.Row], Dict[str, float]]:
    """Follow a trace with one method: rows of messages.csv, and the state of the lab."""
    link.use(METHODS[name])
    begun = time.time()
    link.watch.forget()
    for step in steps:
        time.sleep(max(0.0, begun + step.at - time.time()))
        link.change(step.robot, step.operator)
    time.sleep(max(0.0, begun + seconds - time.time()))
    return [{'way': name, 'topic': heard.topic, 'stamp [s]': round((heard.stamp or 0.0) - begun, 4),
             'arrival [s]': round(heard.arrival - begun, 4), 'amount': round(heard.amount, 4)}
            for heard in link.listener.heard if begun < heard.arrival < begun + seconds], link.watch.state()


def images(folder: pathlib.Path) -> Dict[str, Images]:
    """{method: its images}, without the methods by which none arrived."""
    rows = table.read(folder / 'messages.csv')
    result = {}
    for name, method in METHODS.items():
        mine = [row for row in rows if row['way'] == name]
        topic = method.subscriptions[0][0]
        times = [(row['stamp [s]'], row['arrival [s]']) for row in mine if row['topic'] == topic]
        received = {row['stamp [s]']: row['amount'] for row in mine if row['topic'] != topic}
        if times:
            stamps, arrivals = np.array(times, float).T
            result[name] = Images(stamps, arrivals, received)
    return result


def shown(stamps: FloatArray, arrivals: FloatArray, times: FloatArray) -> Tuple[FloatArray, FloatArray]:
    """At each time the images per second in the WINDOW before, and the age of the last one [s], NaN before the first.

    :param stamps, arrivals: (n,) [s]
    :param times: (m,) [s]
    :return: two (m,)
    """
    arrived = np.searchsorted(arrivals, times, side='right')
    rates: FloatArray = (arrived - np.searchsorted(arrivals, times - WINDOW, side='right')) / WINDOW
    ages: FloatArray = np.where(arrived > 0, times - np.append(stamps, 0.0)[arrived - 1], np.nan)
    return rates, ages


def draw(folder: pathlib.Path, name: str) -> None:
    """Write a figure of the link and of what is shown over time."""
    link = table.read(folder / 'link.csv')
    at = [row['at [s]'] for row in link]
    figure, axes = drawing.canvas(9, 9, rows=4, sharex=True, gridspec_kw={'height_ratios': (1.2, 1, 1, 1)})
    conditions, rate, age, completeness = axes
    for key, factor, style, label in (('loss', 100, '-', 'loss [%]'), ('delay', 1e3, '--', 'delay [ms]'),
                                      ('rate', 1e-6, ':', 'rate [Mbit/s]')):
        conditions.step(at, [row[key] * factor for row in link], where='post', color='black', linestyle=style,
                        label=label)
    times = np.arange(WINDOW, at[-1], STEP)
    for method, found in images(folder).items():
        rates, ages = shown(found.stamps, found.arrivals, times)
        options: Dict[str, Any] = {'color': drawing.COLOURS[method], 'label': method,
                                   'zorder': 3 if method == 'smokebot_udp' else 2}
        rate.plot(times, rates, **options)
        age.plot(times, ages, **options)
        if method == INTERLEAVED:
            shares = [found.received.get(stamp, np.nan) for stamp in found.stamps]
            completeness.plot(found.arrivals, 100 * np.array(shares), '.', markersize=4, **options)
    conditions.set_ylabel('the link')
    rate.set(ylabel='images per second', ylim=(0, 16))
    age.set(ylabel='age of what\nis shown [s]', yscale='log')
    age.yaxis.set_major_formatter(StrMethodFormatter('{x:g}'))
    completeness.set(ylabel='pixels received [%]', xlabel='time [s]', ylim=(-5, 105))
    for ax in axes:
        drawing.legend_right(ax)
    drawing.save(figure, folder / name)
