# SPDX-License-Identifier: BSD-3-Clause
"""The plots of a mission. matplotlib is imported when they are drawn: the rest of the report needs none."""
import functools
import io
import math
from typing import Any, Callable, Dict, List, Mapping, Sequence, Tuple

import numpy as np

from ..arrays import FloatArray
from . import summary
from .mission import Interval, Mission, rate
from .page import Picture, time_text
from .record import OPERATOR, ROBOT

BINS = 300
"""Bins of a plot: a mission of any length has a plot of bounded size."""

LEAST_BIN = 1.0
"""[s]"""

PAUSE, PERIODS = 2.0, 4.0
"""A stream is drawn as missing where it pauses for longer [s], and for longer than so many of its periods."""

SIZE, DPI = (11.0, 2.6), 90
"""Size of a plot [inch], and its resolution [dot/inch]. A timeline has a height of its own."""

ROW = 0.32
"""Height of a row of the timeline [inch]."""

CHARACTERS, LEAST_TEXT = 150, 5
"""Number of characters of the timeline's font in the width of a plot, and minimum length of a text that is cut."""

COLOURS = ('#1f77b4', '#ff7f0e', '#2ca02c', '#9467bd', '#8c564b', '#e377c2', '#7f7f7f', '#bcbd22', '#17becf')
STOP, SEEN = '#d62728', '#2ca02c'


LINK_PLOTS: Sequence[Tuple[str, str, Dict[str, float]]] = (
    ('The link as the robot estimates it.', 'Mbit/s', {'capacity': 1.0, 'rate': 1.0, 'sent': 1.0}),
    ('Packet loss.', '%', {'loss': 100.0}),
    ('Delay of the link.', 'ms', {'queue_delay': 1e3, 'round_trip': 1e3}))
"""[(caption, unit, {field of LinkStatus: factor to the unit})]"""


def draw(mission: Mission) -> List[Picture]:
    """All plots for which there is something to draw.

    :raises ImportError: without matplotlib
    """
    from matplotlib.figure import Figure  # pyplot would need a display
    from matplotlib.ticker import FuncFormatter

    def plot(caption: str, drawing: Callable[[Any], None], size: Tuple[float, float] = SIZE) -> Picture:
        figure = Figure(figsize=size)
        axes = figure.add_subplot(1, 1, 1)
        drawing(axes)
        axes.set_xlim(0.0, max(mission.span[1] - mission.span[0], 1e-3))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda seconds, _: time_text(seconds)[:-2]))
        axes.grid(True, alpha=0.3)
        for side in ('top', 'right'):
            axes.spines[side].set_visible(False)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
        data = io.BytesIO()
        figure.savefig(data, format='png', dpi=DPI, bbox_inches='tight')
        return Picture(data.getvalue(), 'png', caption)

    bars = _bars(mission)
    found = [plot('What was set, who drove, and when the operator received what.', lambda axes: _timeline(
        axes, bars, mission.span[1] - mission.span[0]),
                  (SIZE[0], 0.8 + ROW * len(bars)))]
    if mission.streams('image'):
        found.append(plot('Images per second: dashed on the robot, solid at the operator.',
                          lambda axes: _rates(axes, mission)))
        if any(len(mission.ages(name)[0]) for name in mission.streams('image')):
            found.append(plot('Age of the images when they were published to the operator: median, and range.',
                              lambda axes: _ages(axes, mission)))
    if mission.links:
        found += [plot(caption, functools.partial(_link, mission=mission, unit=unit, fields=fields))
                  for caption, unit, fields in LINK_PLOTS]
        if any(link.by_path for link in mission.links):
            found.append(plot('What was sent by each of two paths.', lambda axes: _paths(axes, mission)))
    return found


def _bars(mission: Mission) -> Dict[str, List[Interval]]:
    """{row: its intervals} of the timeline, from top to bottom."""
    rows = {'focus': summary.focuses(mission), 'driver': summary.drivers(mission),
            'emergency stop': summary.stops(mission), "operator's control": mission.control()}
    for name in mission.streams():
        periods = np.diff(mission.times(OPERATOR, name))
        pause = max(PAUSE, PERIODS * float(np.median(periods))) if len(periods) else PAUSE
        rows[name] = [Interval(begin, end, '') for begin, end in summary.seen(mission, name, pause)]
    return {name: [one._replace(begin=one.begin - mission.span[0], end=one.end - mission.span[0]) for one in found]
            for name, found in rows.items()}


def fitting(text: str, share: float) -> str:
    """What of a text fits into a bar; empty: nothing that can be read.

    :param share: of the width of the plot
    """
    room = int(CHARACTERS * share)
    return text if len(text) <= room else text[:room - 1] + '…' if room >= LEAST_TEXT else ''


def _timeline(axes: Any, rows: Dict[str, List[Interval]], length: float) -> None:
    colours: Dict[str, str] = {}
    for index, (name, intervals) in enumerate(rows.items()):
        for one in intervals:
            colour = STOP if name == 'emergency stop' else SEEN if not one.text else colours.setdefault(
                one.text, COLOURS[len(colours) % len(COLOURS)])
            axes.broken_barh([(one.begin, max(one.duration, 1e-3))], (index - 0.4, 0.8), color=colour)
            text = fitting(one.text, one.duration / max(length, 1e-3))
            if text and name != 'emergency stop':
                axes.text(one.begin, index, ' ' + text, va='center', fontsize=7, clip_on=True)
    axes.set_yticks(range(len(rows)))
    axes.set_yticklabels(list(rows), fontsize=8)
    axes.set_ylim(len(rows) - 0.5, -0.5)


def _width(mission: Mission) -> float:
    """The width of a bin [s]."""
    return max(LEAST_BIN, (mission.span[1] - mission.span[0]) / BINS)


def _rates(axes: Any, mission: Mission) -> None:
    for name, colour in zip(mission.streams('image'), COLOURS):
        for side, style in ((ROBOT, '--'), (OPERATOR, '-')):
            if side in mission.spans:
                times, rates = rate(mission.times(side, name), mission.spans[side], _width(mission))
                axes.plot(times - mission.span[0], rates, style, color=colour,
                          label=name if side == OPERATOR else None)
    axes.set_ylabel('Hz')
    axes.set_ylim(bottom=0.0)


def _ages(axes: Any, mission: Mission) -> None:
    for name, colour in zip(mission.streams('image'), COLOURS):
        times, ages = mission.ages(name)
        middles, groups = binned(times - mission.span[0], ages, _width(mission))
        axes.plot(middles, [1e3 * np.median(group) for group in groups], '.-', markersize=3, color=colour, label=name)
        axes.fill_between(middles, [1e3 * group.min() for group in groups], [1e3 * group.max() for group in groups],
                          color=colour, alpha=0.2, linewidth=0)
    axes.set_ylabel('ms')
    axes.set_ylim(bottom=0.0)


def binned(times: FloatArray, values: FloatArray, width: float) -> Tuple[FloatArray, List[FloatArray]]:
    """Values by bins of time; empty bins are left out.

    :param times, values: (n,), by time
    :return: (middles of the bins, values of each)
    """
    if not len(times):
        return np.zeros(0), []
    bins = np.floor(times / width)
    starts = np.flatnonzero(np.diff(bins, prepend=-math.inf))
    return (bins[starts] + 0.5) * width, np.split(values, starts[1:])


def _link(axes: Any, mission: Mission, unit: str, fields: Dict[str, float]) -> None:
    """Some fields of LinkStatus, with their factors to the unit."""
    _curves(axes, mission, unit, {field.replace('_', ' '): [factor * getattr(link, field) for link in mission.links]
                                  for field, factor in fields.items()})


def _paths(axes: Any, mission: Mission) -> None:
    names = sorted({name for link in mission.links for name in link.by_path})
    _curves(axes, mission, 'Mbit/s', {name: [link.by_path.get(name, 0.0) for link in mission.links] for name in names})


def _curves(axes: Any, mission: Mission, unit: str, curves: Mapping[str, Sequence[float]]) -> None:
    """{label: value of each LinkStatus}, NaN where it is unknown."""
    times = np.array([link.time for link in mission.links]) - mission.span[0]
    for (label, found), colour in zip(curves.items(), COLOURS):
        values = np.array(found)
        known = np.isfinite(values)
        middles, groups = binned(times[known], values[known], _width(mission))
        axes.plot(middles, [group.mean() for group in groups], color=colour, label=label)
    axes.set_ylabel(unit)
    axes.set_ylim(bottom=0.0)
