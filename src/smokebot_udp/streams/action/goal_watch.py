# SPDX-License-Identifier: BSD-3-Clause
"""The goals that an operator sent, until they end.

A goal may be given up on its way, or reach a robot without an action server. The client of actionlib would wait for
ever; here it is known that such a goal is lost. The server may have it all the same, when only its answers were lost:
such a goal is to be cancelled, because nobody follows it any more. So are those that were sent before it: it would have
taken their place, and its client does not follow them. So is a goal whose cancellation was given up on its way. The
robot must not go on with any of them after a cut.
"""
import collections
import dataclasses
import math
from typing import Dict, Iterable, List, Mapping, NamedTuple, Optional, OrderedDict

from ...newest import Newest

MAX_GOALS = 100
"""That are followed at the same time, and as many that are lost or cancelled."""

CANCEL_PERIOD = 1.0
"""A goal that nobody wants any more, but the robot pursues, is cancelled again after this time [s]."""


class Lost(NamedTuple):
    """A goal that the robot does not have, as far as is known."""
    goal: str
    replaced: List[str]
    """Those sent before it that have not ended, as far as is known: they are to be cancelled."""


@dataclasses.dataclass
class _Sent:
    """A goal that has not ended."""
    stamp: float
    """Stamp of the goal's id [s]."""
    until: float
    """When it is lost; infinity: it was heard of."""


class GoalWatch:
    """Follows goals by their ids. The clock is an argument [s, any steady clock].

    :param timeout: time without a status or a result after which a goal is lost [s]
    """

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self._sent: OrderedDict[str, _Sent] = collections.OrderedDict()    # the oldest first
        self._unwanted: Newest[str, float] = Newest(MAX_GOALS)     # when each may be cancelled again
        self._pursued: Dict[str, float] = {}

    def sent(self, goal: str, stamp: float, now: float) -> None:
        """A goal leaves. One without an id gets it on the robot, and cannot be followed."""
        if not goal:
            return
        if len(self._sent) >= MAX_GOALS:    # a goal of which was heard may have ended unheard
            heard = next((one for one, sent in self._sent.items() if sent.until == math.inf), None)
            if heard is None:
                return
            del self._sent[heard]
        self._sent[goal] = _Sent(stamp, now + self.timeout)

    def failed(self, now: float) -> List[str]:
        """A goal cannot even leave; returns those sent before it, as of Lost."""
        return self._replace(list(self._sent), now)

    @property
    def unheard(self) -> List[str]:
        """The goals that are on their way, as far as is known."""
        return [goal for goal, sent in self._sent.items() if sent.until < math.inf]

    def heard(self, goals: Iterable[str]) -> None:
        """The robot has these goals, or had them."""
        for goal in goals:
            if goal in self._sent:
                self._sent[goal].until = math.inf

    def ended(self, goals: Iterable[str]) -> None:
        """The robot has had these goals."""
        for goal in goals:
            self._sent.pop(goal, None)

    def cancelled(self, goal: str, stamp: float, now: float) -> None:
        """A client cancels a goal, and all that are not newer than a stamp; without both: all.

        :param goal: empty: none
        :param stamp: 0: none [s]
        """
        known = {**self._pursued, **{one: sent.stamp for one, sent in self._sent.items()}}
        for one, made in {**known, **({goal: 0.0} if goal else {})}.items():
            if one == goal or 0 < made <= stamp or not (goal or stamp):
                self._give_up(one, now + CANCEL_PERIOD)

    def to_cancel(self, pursued: Mapping[str, float], now: float) -> List[str]:
        """Those goals that the robot pursues although they are lost or cancelled, and that are to be cancelled now.

        :param pursued: {goal: stamp of its id}
        """
        self._pursued = dict(pursued)
        found = [goal for goal in pursued if self._unwanted.get(goal, now + 1.0) <= now]
        for goal in found:
            self._unwanted[goal] = now + CANCEL_PERIOD
        return found

    def poll(self, now: float) -> Optional[Lost]:
        """A goal that is lost now; None: there is none until `deadline`."""
        goals = list(self._sent)
        for number, goal in enumerate(goals):
            if self._sent[goal].until <= now:
                del self._sent[goal]
                self._give_up(goal, now)
                return Lost(goal, self._replace(goals[:number], now))
        return None

    def deadline(self) -> Optional[float]:
        """When the next goal is lost; None: all were heard of."""
        first = min((sent.until for sent in self._sent.values()), default=math.inf)
        return None if first == math.inf else first

    def _replace(self, goals: List[str], now: float) -> List[str]:
        """These goals are to be cancelled at once, where the robot pursues them."""
        for goal in goals:
            self._give_up(goal, now)
        return goals

    def _give_up(self, goal: str, due: float) -> None:
        """A goal is to be cancelled from a time on, where the robot pursues it."""
        self._unwanted[goal] = due
