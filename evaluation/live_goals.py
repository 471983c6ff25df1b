# SPDX-License-Identifier: BSD-3-Clause
"""What `bench live` is to show of the nodes as shipped, and where it does not. Pure."""
import math
from typing import Any, Dict, List, Mapping, Optional, Sequence

from .gst_pipelines import WAYS
from .live_score import Row

OURS, IDEAL, PLAIN = 'ours', 'ideal', 'gst'
MENDING = [name for name in WAYS if name != PLAIN]
"""Methods of GStreamer that restore what is lost."""

BEHIND = 1.0
"""Maximum distance of the screen's mean PSNR below that of the ideal method [dB]."""

BELOW, WORST_BELOW, STEADY_LOSS = 2.0, 6.0, 20.0
"""Maximum distances of the 5th percentile and of the worst image below the mean [dB], up to a packet loss [%]."""

LATER = 0.04
"""Maximum excess of the median age of images over plain GStreamer's, where nothing is lost [s]."""

AHEAD, AHEAD_5 = 3.0, 6.0
"""Minimum lead over plain GStreamer where something is lost: of the mean, and of the 5th percentile [dB]."""

USED, KNOWN = 0.85, 0.95
"""Minimum part of the link that is used while images are blurred, and of the time in which the capacity is known."""
OLDEST, STEADY_DOWN, STEADY_UP = 0.4, 1.0, 2.0
"""Maximum age of an image after a step of the rate, and maximum time until quality is steady after a step down and up
[s]."""

IDLE = 0.03
"""Maximum part of the link that is used for what nobody asked for."""


class Judge:
    """Collects what was missed."""

    def __init__(self) -> None:
        self.missed: List[str] = []

    def least(self, cell: str, name: str, value: Optional[float], goal: Optional[float]) -> None:
        """A value is to be at least this; None: it was not measured."""
        if value is not None and goal is not None and not value >= goal:
            self.missed.append('%s: %s is %.4g, should be at least %.4g' % (cell, name, value, goal))

    def most(self, cell: str, name: str, value: Optional[float], goal: Optional[float]) -> None:
        """A value is to be at most this; None: it was not measured."""
        if value is not None and goal is not None and not value <= goal:
            self.missed.append('%s: %s is %.4g, should be at most %.4g' % (cell, name, value, goal))


def missed(results: Mapping[str, Any]) -> List[str]:
    """What was missed, a line each.

    :param results: see live_cells.measure
    """
    judge = Judge()
    cells: Dict[str, Dict[str, Row]] = {}
    for row in results['rows']:
        cells.setdefault(row['cell'], {})[row['method']] = row
    for cell, by_method in cells.items():
        if OURS in by_method:
            _judge_cell(judge, cell, by_method)
    _judge_steps(judge, [row for row in results['steps'] if row['method'] == OURS])
    for row in results['idle']:
        if row['streams'] != 'none':
            judge.most(row['cell'], 'what crosses beside the images [kbit/s]', row['to operator then [kbit/s]'],
                       IDLE * 1e3 * row['link [Mbit/s]'])
    return judge.missed


def _less(value: Optional[float], by: float) -> Optional[float]:
    return None if value is None else value - by


def _judge_cell(judge: Judge, cell: str, by_method: Mapping[str, Row]) -> None:
    ours, nothing = by_method[OURS], {}     # type: Row, Row
    ideal, plain, lossy = by_method.get(IDEAL, nothing), by_method.get(PLAIN, nothing), ours['loss [%]'] > 0
    screen, mean, five = 'screen mean [dB]', 'image mean [dB]', 'image 5 % [dB]'
    judge.least(cell, 'the screen, beside the ideal one [dB]', ours[screen], _less(ideal.get(screen), BEHIND))
    for peer in WAYS:
        judge.least(cell, 'the screen, beside %s [dB]' % peer, ours[screen], by_method.get(peer, nothing).get(screen))
    if ours['loss [%]'] <= STEADY_LOSS:
        judge.least(cell, 'the 5th percentile of images [dB]', ours[five], _less(ours[mean], BELOW))
        judge.least(cell, 'the worst image [dB]', ours['image worst [dB]'], _less(ours[mean], WORST_BELOW))
    if not lossy:
        judge.most(cell, 'the age p50 [s]', ours['age p50 [s]'], _less(plain.get('age p50 [s]'), -LATER))
    elif ours['loss [%]'] <= STEADY_LOSS:
        for name, ahead in ((mean, AHEAD), (five, AHEAD_5)):
            judge.least(cell, '%s, beside plain GStreamer' % name, ours[name], _less(plain.get(name), -ahead))
            for peer in MENDING:
                judge.least(cell, '%s, beside %s' % (name, peer), ours[name], by_method.get(peer, nothing).get(name))
    judge.least(cell, 'the part of the link that is used while images are blurred', ours['used while blurred'], USED)
    judge.least(cell, 'the share of time in which the capacity is known', ours['capacity known'], KNOWN)


def _judge_steps(judge: Judge, rows: Sequence[Row]) -> None:
    for before, row in zip([None, *rows], rows):
        if before is None or before['cell'] != row['cell']:
            continue
        step = '%s, at %g Mbit/s' % (row['cell'], row['rate'])
        judge.most(step, 'the oldest image [s]', row['oldest [s]'], OLDEST)
        after = row['steady after [s]']
        judge.most(step, 'the time until it is steady [s]', math.inf if after is None else after,
                   STEADY_DOWN if row['rate'] < before['rate'] else STEADY_UP)
