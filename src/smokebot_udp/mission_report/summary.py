# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of a mission, and what happened in it."""
import math
import re
from typing import Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from .gaps import LEAST_GAP, Gap, gaps
from .mission import Interval, Mission
from .record import OPERATOR, ROBOT, SIDES

NUMBER = re.compile(r'[0-9.]+')
"""In the state of a control that counts: `the robot was not heard for 2.1 s`."""

LINK_PERIOD = 2.0
"""Twice the longest time between two LinkStatus while the robot runs [s]."""

SAME = 10.0
"""What comes again within this time has the same cause [s]."""


class Row(NamedTuple):
    """A stream in numbers; None: unknown, or that side was not recorded."""
    name: str
    type: str
    rates: Dict[str, Optional[float]]
    """{side: messages per second that it recorded} [Hz]"""
    counts: Dict[str, int]
    """{side: messages}"""
    age: Optional[float]
    """Median age of the messages at the operator's [s]."""
    old: Optional[float]
    """Age that 95 % of the messages did not exceed at the operator's [s]."""
    longest: Optional[float]
    """Longest time without a message at the operator's, of images only [s]."""


class Event(NamedTuple):
    """Something that happened."""
    time: float
    """By the robot's clock [s]."""
    kind: str
    """Kind of the event: focus, driver, stop, control or gap."""
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


def sent_by_path(mission: Mission) -> Dict[str, float]:
    """{path: what streams sent by it [MB]}, where there were two; while no LinkStatus was recorded nothing counts."""
    total: Dict[str, float] = {}
    for link, later in zip(mission.links, mission.links[1:]):
        for name, sent in link.by_path.items():
            total[name] = total.get(name, 0.0) + sent / 8 * min(later.time - link.time, LINK_PERIOD)
    return total


def focuses(mission: Mission) -> List[Interval]:
    return mission.intervals(lambda state: state.focus)


def drivers(mission: Mission) -> List[Interval]:
    return mission.intervals(lambda state: state.driver)


def stops(mission: Mission) -> List[Interval]:
    """When the emergency stop was engaged."""
    return mission.intervals(lambda state: 'EMERGENCY STOP' if state.estop else '')


def all_gaps(mission: Mission) -> List[Gap]:
    """The gaps of all image streams, the longest first."""
    return sorted((gap for name in mission.streams('image') for gap in gaps(mission, name)),
                  key=lambda gap: -gap.duration)


def events(mission: Mission) -> List[Event]:
    """What happened, by time."""
    found = [Event(one.begin, 'focus', "focus '%s'" % one.text) for one in focuses(mission)]
    for spell in _spells(drivers(mission), str):
        found.append(Event(spell.begin, 'driver', _counted('%s drives' % spell.text, spell)))
        if spell.end < mission.span[1]:
            found.append(Event(spell.end, 'driver', '%s no longer drives' % spell.text))
    found += [Event(one.begin, 'stop', 'emergency stop engaged') for one in stops(mission)]
    found += [Event(one.end, 'stop', 'emergency stop released') for one in stops(mission) if one.end < mission.span[1]]
    found += [Event(spell.begin, 'control', _counted("operator's control: %s" % spell.text, spell))
              for spell in _spells(mission.control(), lambda text: NUMBER.sub('', text))]
    found += [Event(one[0].begin, 'gap', 'no new image of %s for %.1f s (%s)' % (
        ', '.join(sorted({gap.stream for gap in one})), max(gap.duration for gap in one), one[0].cause))
        for one in _with_one_cause(all_gaps(mission))]
    return sorted(found)


class _Spell(NamedTuple):
    """Intervals of one kind that follow each other closely."""
    text: str
    """Text of the last interval."""
    begin: float
    end: float
    times: int


def _spells(intervals: Sequence[Interval], kind: Callable[[str], str]) -> List[_Spell]:
    """The spells of intervals.

    :param intervals: by time
    :param kind: f(text) -> what those of one spell have in common
    """
    found: Dict[str, List[_Spell]] = {}
    for one in intervals:
        spells = found.setdefault(kind(one.text), [])
        if spells and one.begin - spells[-1].end < SAME:
            spells[-1] = spells[-1]._replace(text=one.text, end=one.end, times=spells[-1].times + 1)
        else:
            spells.append(_Spell(one.text, one.begin, one.end, 1))
    return [spell for spells in found.values() for spell in spells]


def _counted(text: str, spell: _Spell) -> str:
    """What happened, and how often."""
    return text if spell.times == 1 else '%s (%d times within %.0f s)' % (text, spell.times, spell.end - spell.begin)


def _with_one_cause(found: Sequence[Gap]) -> List[List[Gap]]:
    """Gaps of all streams, those of one cause at one time together, by time."""
    groups: List[List[Gap]] = []
    for gap in sorted(found, key=lambda gap: gap.begin):
        group = next((group for group in reversed(groups) if group[0].cause == gap.cause
                      and gap.begin < max(one.end for one in group) + LEAST_GAP), None)
        if group is None:
            groups.append([gap])
        else:
            group.append(gap)
    return groups


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
