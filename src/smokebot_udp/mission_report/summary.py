# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of a mission, and what happened in it."""
import math
from typing import Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from .gaps import Gap, gaps
from .mission import Interval, Mission
from .record import OPERATOR, ROBOT, SIDES


class Row(NamedTuple):
    """A stream in numbers; None: unknown, or that side was not recorded."""
    name: str
    type: str
    rates: Dict[str, Optional[float]]
    """{side: messages per second that it recorded} [Hz]"""
    counts: Dict[str, int]
    """{side: messages}"""
    age: Optional[float]
    """Median at the operator's [s]."""
    old: Optional[float]
    """95 % of the messages were not older [s]."""
    longest: Optional[float]
    """Longest time without a message at the operator's [s]; of images."""


class Event(NamedTuple):
    """Something that happened."""
    time: float
    """By the robot's clock [s]."""
    kind: str
    """focus, driver, stop, control or gap"""
    text: str


def rows(mission: Mission) -> List[Row]:
    """All streams to the operator."""
    found = []
    for name in mission.streams():
        counts = {side: len(mission.times(side, name)) for side in SIDES}
        rates = {side: counts[side] / max(end - begin, 1e-9) for side, (begin, end) in mission.spans.items()
                 if end > begin}
        kind = mission.record.streams[name].type
        ages = mission.ages(name)[1] if kind != 'relay' else ()     # a latched message is old
        longest = max((gap.duration for gap in gaps(mission, name)), default=0.0) if kind == 'image' else None
        found.append(Row(name, kind, {side: rates.get(side) for side in SIDES}, counts,
                         float(np.median(ages)) if len(ages) else None,
                         float(np.percentile(ages, 95)) if len(ages) else None,
                         longest if OPERATOR in mission.spans else None))
    return found


def distance(mission: Mission) -> Optional[float]:
    """How far the robot drove, by its odometry [m]; None: it was not recorded."""
    way = mission.record.ways[ROBOT] or mission.record.ways[OPERATOR]
    if not way:
        return None
    places = np.array(sorted(way))[:, 1:]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def link_means(mission: Mission) -> Dict[str, Optional[float]]:
    """{field of LinkStatus: mean over the mission}; None: unknown. Without limits (0 Mbit/s) the rate is unknown."""
    means: Dict[str, Optional[float]] = {}
    for field in ('sent', 'capacity', 'loss', 'queue_delay', 'round_trip'):
        values = [value for value in (getattr(link, field) for link in mission.links) if math.isfinite(value)]
        means[field] = sum(values) / len(values) if values else None
    return means


def focuses(mission: Mission) -> List[Interval]:
    return mission.intervals(lambda state: state.focus)


def drivers(mission: Mission) -> List[Interval]:
    return mission.intervals(lambda state: state.driver)


def stops(mission: Mission) -> List[Interval]:
    """When the emergency stop was engaged."""
    return mission.intervals(lambda state: 'EMERGENCY STOP' if state.estop else '')


def all_gaps(mission: Mission) -> List[Gap]:
    """Of all images, the longest first."""
    return sorted((gap for name in mission.streams('image') for gap in gaps(mission, name)),
                  key=lambda gap: -gap.duration)


def events(mission: Mission) -> List[Event]:
    """What happened, by time."""
    found = [Event(one.begin, 'focus', "focus '%s'" % one.text) for one in focuses(mission)]
    found += [Event(one.begin, 'driver', '%s drives' % one.text) for one in drivers(mission)]
    found += [Event(one.end, 'driver', '%s no longer drives' % one.text) for one in drivers(mission)
              if one.end < mission.span[1]]
    found += [Event(one.begin, 'stop', 'emergency stop engaged') for one in stops(mission)]
    found += [Event(one.end, 'stop', 'emergency stop released') for one in stops(mission) if one.end < mission.span[1]]
    found += [Event(one.begin, 'control', "operator's control: %s" % one.text) for one in mission.control()]
    found += [Event(gap.begin, 'gap', 'no new image of %s for %.1f s (%s)' % (gap.stream, gap.duration, gap.cause))
              for gap in all_gaps(mission)]
    return sorted(found)


def seen(mission: Mission, name: str, pause: float) -> List[Tuple[float, float]]:
    """When the operator had a stream: [(begin, end), ...] by the robot's clock [s].

    :param pause: the time without a message that ends an interval [s]
    """
    times = mission.times(OPERATOR, name)
    if not len(times):
        return []
    ends = np.flatnonzero(np.diff(times) > pause)
    firsts, lasts = np.append(0, ends + 1), np.append(ends, len(times) - 1)
    return [(float(times[first]), float(times[last])) for first, last in zip(firsts, lasts)]
