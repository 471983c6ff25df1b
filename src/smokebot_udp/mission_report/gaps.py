# SPDX-License-Identifier: BSD-3-Clause
"""Times without a new image at the operator's, and what they are due to."""
from typing import Callable, List, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..monitoring.computer import OVERLOAD
from .mission import Mission, Span
from .record import LOAD_PERIOD as PERIOD
from .record import OPERATOR, ROBOT, SIDES, State

LEAST_GAP = 1.0
"""Shorter ones are not listed [s]."""

PERIODS = 2.5
"""Neither are those of fewer periods of the rate that the stream is set to."""

MOST = 0.8
"""A reason explains a gap if it holds for this part of it."""

MAIN = 0.5
"""A cut of this part of a gap is its cause: the rate has to grow again after it, and large streams come last."""

STALLED = 2 * OVERLOAD
"""Programs for each processor: a second without a message may be due to that as well as to the link."""

LEAST_TOLD = 0.3
"""A machine that tells its load less often than this part of what it should stood still."""

CUT, SOURCE, UNKNOWN = 'nothing arrived: the link was cut', 'the source on the robot was silent', (
    'images were lost or late, other streams arrived')
CUT_FOR = 'nothing arrived for %.0f s of it: the link was cut'
STOOD = "the %s recorded nothing at all: its machine stood still, or the recording was interrupted"
BUSY = "the %s's machine was overloaded: %.1f programs for each processor"
OFF, PAUSED = "focus '%s' does not send it", 'paused: the link was too slow for it'
"""Causes."""


class Gap(NamedTuple):
    """A time without a new image."""
    stream: str
    begin: float
    """The last image before, or the beginning of the recording [s]."""
    end: float
    cause: str

    @property
    def duration(self) -> float:
        return self.end - self.begin


def gaps(mission: Mission, name: str) -> List[Gap]:
    """The gaps of a stream while all sides recorded, by time."""
    if OPERATOR not in mission.spans:
        return []
    begin, end = mission.common
    times = mission.times(OPERATOR, name)
    edges = np.concatenate([[begin], times[(times > begin) & (times < end)], [end]])
    found = []
    for index in np.flatnonzero(np.diff(edges) > LEAST_GAP):
        span = float(edges[index]), float(edges[index + 1])
        state = mission.state(span[0])
        rate = state.streams.get(name, (True, False, 0.0))[2] if state else 0.0
        if rate <= 0 or span[1] - span[0] > PERIODS / rate:
            found.append(Gap(name, *span, _cause(mission, name, span)))
    return found


def _cause(mission: Mission, name: str, span: Span) -> str:
    most = MOST * (span[1] - span[0])
    off = share(mission, lambda state: name in state.streams and not state.streams[name][0], span)
    if off >= most:
        state = mission.state((span[0] + span[1]) / 2)
        return OFF % (state.focus if state else '')
    silence = longest(mission.arrivals, span)
    if silence >= most:
        return still(mission, span) or ' or '.join(filter(None, [CUT, overload(mission, span, STALLED)]))
    if silence >= max(LEAST_GAP, MAIN * (span[1] - span[0])):
        return still(mission, span) or CUT_FOR % silence
    if share(mission, lambda state: name in state.streams and state.streams[name][1], span) >= most:
        return PAUSED
    if ROBOT in mission.spans and longest(mission.times(ROBOT, name), span) >= most:
        return SOURCE
    return still(mission, span) or overload(mission, span, OVERLOAD) or UNKNOWN


def still(mission: Mission, span: Span) -> str:
    """Which machine stood still in a span; empty: none, or nobody recorded that."""
    least = LEAST_TOLD * (span[1] - span[0]) / PERIOD
    return next((STOOD % side for side in SIDES if mission.record.loads[side]
                 and mission.load(side, span)[0] < least), '')


def overload(mission: Mission, span: Span, least: float) -> str:
    """Which machine was too slow in a span; empty: none, or nobody recorded that.

    :param least: load that explains it
    """
    loads = {side: mission.load(side, span)[1] for side in SIDES}
    return next((BUSY % (side, load) for side, load in loads.items() if load >= least), '')


def share(mission: Mission, holds: Callable[[State], bool], span: Span) -> float:
    """For how long of a span the robot's state was as f(state) says [s]."""

    intervals = mission.intervals(lambda state: 'yes' if holds(state) else '')
    return sum(max(0.0, min(one.end, span[1]) - max(one.begin, span[0])) for one in intervals)


def longest(times: FloatArray, span: Span) -> float:
    """The longest time without any of these, within a span [s].

    :param times: (n,) [s], ascending
    """
    begin, end = np.searchsorted(times, span[0], side='right'), np.searchsorted(times, span[1], side='left')
    return float(np.diff(np.concatenate([[span[0]], times[begin:end], [span[1]]])).max())
