# SPDX-License-Identifier: BSD-3-Clause
"""What the operator sees while the link goes through a course, for each way of sending: measured and drawn."""
import bisect
import time
from dataclasses import replace

import numpy as np

from smokebot_udp.link_lab import course as courses

from . import drawing, table
from .crossing import PICTURES, Crossing, Way

WAYS = {
    'smokebot_udp': Way('camera/image_raw', [['operator/camera/image_raw', 'image', 'TCPROS'],
                                             ['operator/camera/mask', 'mask', 'TCPROS']]),
    'JPEG over TCPROS': PICTURES['JPEG over TCPROS'],
    'JPEG over UDPROS': PICTURES['JPEG over UDPROS'],
}

CAPTION = ('From above: the link; how many pictures come; how old the newest one is that the operator has; and how '
           'much of each was received and not filled.')

QUICK_WAYS = 'smokebot_udp', 'JPEG over TCPROS'

WINDOW = 1.0
"""Pictures are counted over so long [s]."""

STEP = 0.1
"""Of what is drawn [s]."""


def run(run, course, seconds, quick_haste):
    """Go through a course once for each way; writes messages.csv, link.csv and state.csv.

    :param course: text of a link.yaml
    :param seconds: how long it takes
    :param quick_haste: in a quick run all is done so many times as fast
    """
    haste = quick_haste if run.quick else 1.0
    steps = [replace(step, at=step.at / haste) for step in courses.load(course)[1]]
    rows, states = [], []
    with Crossing(run, adapt=True) as crossing:
        for name in run.steps(QUICK_WAYS if run.quick else WAYS, say=str):
            crossing.use(WAYS[name])
            begun = time.time()
            crossing.state()
            for step in steps:
                time.sleep(max(0.0, begun + step.at - time.time()))
                crossing.change(step.robot, step.operator)
            time.sleep(max(0.0, begun + seconds / haste - time.time()))
            rows += [{'way': name, 'topic': heard.topic, 'stamp [s]': round(heard.stamp - begun, 4),
                      'arrival [s]': round(heard.arrival - begun, 4), 'amount': round(heard.amount, 4)}
                     for heard in crossing.listener.heard if begun < heard.arrival < begun + seconds / haste]
            states.append({'way': name, **crossing.state()})
    table.write(run.folder / 'messages.csv', rows)
    table.write(run.folder / 'state.csv', states)
    table.write(run.folder / 'link.csv', [{'at [s]': step.at, **vars(step.robot)} for step in steps] +
                [{'at [s]': seconds / haste, **vars(steps[-1].robot)}])


def messages(folder):
    """{way: ((n,) stamps, (n,) arrivals of pictures [s], {stamp: share of the pixels that came})}, where any came"""
    rows = table.read(folder / 'messages.csv')
    result = {}
    for name, way in WAYS.items():
        pictures = [(row['stamp [s]'], row['arrival [s]']) for row in rows
                    if row['way'] == name and row['topic'] == way.wanted[0][0]]
        masks = {row['stamp [s]']: row['amount'] for row in rows
                 if row['way'] == name and row['topic'] != way.wanted[0][0]}
        if not pictures:
            continue
        result[name] = (*np.array(pictures, float).reshape(-1, 2).T, masks)
    return result


def shown(stamps, arrivals, times):
    """Of each time: how many pictures came in the WINDOW before, and how old the last one is then: NaN before one."""
    counts = np.array([bisect.bisect(arrivals, t) - bisect.bisect(arrivals, t - WINDOW) for t in times]) / WINDOW
    last = np.searchsorted(arrivals, times, side='right') - 1
    ages = np.where(last >= 0, times - np.append(stamps, 0.0)[last], np.nan)
    return counts, ages


def draw(folder, name):
    """Write a figure of the link and of what is shown over time."""
    link = table.read(folder / 'link.csv')
    at = [row['at [s]'] for row in link]
    times = np.arange(WINDOW, at[-1], STEP)
    figure, axes = drawing.canvas(9, 9, rows=4, sharex=True, gridspec_kw={'height_ratios': (1.2, 1, 1, 1)})
    quality, rate, age, completeness = axes
    for key, factor, style, label in (('loss', 100, '-', 'loss [%]'), ('delay', 1e3, '--', 'delay [ms]'),
                                      ('rate', 1e-6, ':', 'rate [Mbit/s]')):
        quality.step(at, [row[key] * factor for row in link], where='post', color='black', linestyle=style, label=label)
    quality.set_ylabel('the link')
    for way, (stamps, arrivals, masks) in messages(folder).items():
        counts, ages = shown(stamps, arrivals, times)
        options = {'color': drawing.WAYS[way], 'label': way, 'zorder': 3 if way == 'smokebot_udp' else 2}
        rate.plot(times, counts, **options)
        age.plot(times, ages, **options)
        shares = [masks.get(stamp, np.nan) for stamp in stamps] if masks else np.ones(len(stamps))
        completeness.plot(arrivals, 100 * np.array(shares), '.', markersize=4, **options)
    rate.set(ylabel='pictures a second', ylim=(0, 16))
    age.set(ylabel='age of what\nis shown [s]', yscale='log')
    age.yaxis.set_major_formatter('{x:g}')
    completeness.set(ylabel='pixels measured [%]', xlabel='time [s]', ylim=(-5, 105))
    for ax in axes:
        ax.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    drawing.save(figure, folder / name)
