# SPDX-License-Identifier: BSD-3-Clause
"""A mission by the robot's clock: when messages came, how old they were, what was set, and who drove."""
import datetime
import math
from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, TypeVar

import numpy as np

from ..arrays import FloatArray
from .record import OPERATOR, ROBOT, SIDES, MissionRecord, State

Kept = TypeVar('Kept')
Span = Tuple[float, float]
"""(begin, end) by the robot's clock [s]"""


class Interval(NamedTuple):
    """Something that stayed the same for a while."""
    begin: float
    """By the robot's clock [s]."""
    end: float
    text: str

    @property
    def duration(self) -> float:
        return self.end - self.begin


class RobotClock:
    """Converts the operator's times: all times of the report are by the robot's clock, as the stamps are.

    :param offsets: {time by the operator's clock: the robot's clock minus the operator's} [s]; empty: unknown, they are
        taken for the same
    """

    def __init__(self, offsets: Mapping[float, float]) -> None:
        self._times = np.array(sorted(offsets))
        self._offsets = np.array([offsets[time] for time in sorted(offsets)])

    @property
    def is_known(self) -> bool:
        return len(self._times) > 0

    @property
    def median(self) -> float:
        """The median offset [s]; 0: unknown."""
        return float(np.median(self._offsets)) if self.is_known else 0.0

    def of_operator(self, times: FloatArray) -> FloatArray:
        """The operator's times by the robot's clock, (n,) [s]: between estimates the offset is interpolated."""
        return times + np.interp(times, self._times, self._offsets) if self.is_known else times


class Mission:
    """What both sides have recorded.

    :raises ValueError: where the sides did not record at the same time
    """

    def __init__(self, record: MissionRecord) -> None:
        self.record, self.clock = record, RobotClock(record.offsets)
        self.spans: Dict[str, Span] = {
            side: self._robot_times(side, record.spans[side]) for side in SIDES if side in record.spans}
        """{side: from its first to its last message}"""
        self.span: Span = min(begin for begin, _ in self.spans.values()), max(end for _, end in self.spans.values())
        self.common: Span = max(begin for begin, _ in self.spans.values()), min(end for _, end in self.spans.values())
        """Span in which all sides with bags recorded."""
        if self.common[0] > self.common[1]:
            raise ValueError('the bags are of different times: ' + ', '.join(
                'the %s recorded from %s to %s' % (side, *map(clock_text, span)) for side, span in self.spans.items()))
        self.states = _by_time(record.states)
        """States of the robot, by time: those that the robot recorded, else those that arrived at the operator."""
        self.links = _by_time(record.links)
        """States of the link, by time: those that the robot recorded, else those that arrived at the operator."""
        self._times: Dict[Tuple[str, str], FloatArray] = {}
        arrived = [self.times(OPERATOR, name) for name in self.streams()]
        self.arrivals: FloatArray = np.sort(np.concatenate([*arrived, np.zeros(0)]))
        """When the operator recorded any message that came from the robot, (messages,) [s], ascending."""

    def _robot_times(self, side: str, span: Span) -> Span:
        begin, end = self.clock.of_operator(np.array(span)) if side == OPERATOR else np.array(span)
        return float(begin), float(end)

    def times(self, side: str, name: str) -> FloatArray:
        """When a side recorded the messages of a stream, (messages,) [s], ascending."""
        if (side, name) not in self._times:
            track = self.record.tracks[side].get(name)
            times = np.zeros(0) if track is None else track.sorted()[0]
            self._times[side, name] = self.clock.of_operator(times) if side == OPERATOR else times
        return self._times[side, name]

    def ages(self, name: str) -> Tuple[FloatArray, FloatArray]:
        """(times, ages) of the operator's messages of a stream that have a stamp, each (messages,) [s]."""
        track = self.record.tracks[OPERATOR].get(name)
        if track is None:
            return np.zeros(0), np.zeros(0)
        times, stamps, _ = track.sorted()
        times = self.clock.of_operator(times)
        known = np.isfinite(stamps)
        return times[known], (times - stamps)[known]

    def streams(self, kind: str = '') -> List[str]:
        """The streams to the operator of which some side has messages, in the order of streams.yaml.

        :param kind: their type; empty: all
        """
        return [name for name, stream in self.record.streams.items()
                if not stream.to_robot and kind in ('', stream.type)
                and any(name in self.record.tracks[side] for side in SIDES)]

    def state(self, time: float) -> Optional[State]:
        """The robot's state at a time; None: unknown."""
        index = int(np.searchsorted([state.time for state in self.states], time, side='right'))
        return self.states[index - 1] if index else None

    def intervals(self, text: Callable[[State], str]) -> List[Interval]:
        """For how long the robot's state said the same; what it was before the first one is unknown.

        :param text: f(state) -> what it says; empty: nothing
        """
        return joined([(state.time, text(state)) for state in self.states], self.span)

    def load(self, side: str, span: Span) -> Tuple[int, float]:
        """How often a side told of its machine's load within a span, and the mean of that; nan: never."""
        loads = self.record.loads[side]
        times = np.array(sorted(loads))
        converted = self.clock.of_operator(times) if side == OPERATOR else times
        found = [loads[key] for key, time in zip(times.tolist(), converted.tolist()) if span[0] <= time <= span[1]]
        return len(found), float(np.mean(found)) if found else math.nan

    def control(self) -> List[Interval]:
        """The state of the operator's control."""
        times = sorted(self.record.control)
        converted = self.clock.of_operator(np.array(times))
        return joined([(float(time), self.record.control[key]) for key, time in zip(times, converted)], self.span)


def clock_text(time: float) -> str:
    """A time as date and time of day, UTC."""
    return datetime.datetime.fromtimestamp(time, datetime.timezone.utc).strftime('%Y-%m-%d %H:%M:%S UTC')


def _by_time(found: Mapping[str, Mapping[float, Kept]]) -> List[Kept]:
    """What the robot recorded, else the operator.

    :param found: {side: {time: state}}
    """
    states = found[ROBOT] or found[OPERATOR]
    return [states[time] for time in sorted(states)]


def joined(changes: Sequence[Tuple[float, str]], span: Span) -> List[Interval]:
    """The intervals between changes; equal ones become one, empty texts none.

    :param changes: [(time, text from then on), ...] by time
    :param span: outside there is nothing
    """
    found: List[Interval] = []
    ends = [time for time, _ in changes[1:]] + [span[1]]
    for (begin, text), end in zip(changes, ends):
        begin, end = max(begin, span[0]), min(end, span[1])
        if not text or end <= begin:
            continue
        if found and found[-1].text == text and found[-1].end == begin:
            found[-1] = found[-1]._replace(end=end)
        else:
            found.append(Interval(begin, end, text))
    return found


def rate(times: FloatArray, span: Span, width: float) -> Tuple[FloatArray, FloatArray]:
    """Messages a second over time.

    :param width: of the bins; the last one is as long as what is left [s]
    :return: (middle of each bin [s], rate [Hz]), each of shape (bins,)
    """
    begins = np.arange(span[0], span[1], width)
    kept = begins < span[1] - 1e-6 * width      # by rounding the last one may lie at the end, or beyond
    kept[:1] = True
    edges = np.append(begins[kept], span[1])
    counts = np.histogram(times, edges)[0]
    return (edges[1:] + edges[:-1]) / 2, counts / np.maximum(np.diff(edges), 1e-9)
