# SPDX-License-Identifier: BSD-3-Clause
"""The goals that an operator sent, until the robot's action server shows that it has them.

A goal may be given up on its way, or reach a robot without an action server. The client of actionlib would wait for
ever; here it is known that such a goal is lost. The server may have it all the same, when only its answers were lost:
such a goal is to be cancelled, because nobody follows it any more. So is a goal whose cancellation was given up on its
way: the robot must not go on with it after a cut.
"""
import collections
from typing import Dict, Iterable, List, Optional, OrderedDict

MAX_GOALS = 100
"""That are followed at the same time, and as many that are lost or cancelled."""

CANCEL_PERIOD = 1.0
"""A goal that nobody wants any more, but the robot pursues, is cancelled again after this time [s]."""


class GoalWatch:
    """Follows goals by their ids. The clock is an argument [s, any steady clock].

    :param patience: a goal of which nothing was heard for this time is lost [s]
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self._until: Dict[str, float] = {}                 # of goals of which nothing was heard, oldest first
        self._unwanted: OrderedDict[str, float] = collections.OrderedDict()    # when each may be cancelled again
        self._pursued: List[str] = []

    def sent(self, goal: str, now: float) -> None:
        """A goal leaves. One without an id gets it on the robot, and cannot be followed."""
        if goal and len(self._until) < MAX_GOALS:
            self._until[goal] = now + self.patience

    @property
    def unheard(self) -> List[str]:
        """The goals that are on their way, as far as is known."""
        return list(self._until)

    def heard(self, goals: Iterable[str]) -> None:
        """The robot has these goals, or had them."""
        for goal in goals:
            self._until.pop(goal, None)

    def cancelled(self, goal: str, now: float) -> None:
        """A client cancels a goal; empty: all."""
        for one in [goal] if goal else [*self._pursued, *self._until]:
            self._give_up(one, now + CANCEL_PERIOD)

    def to_cancel(self, pursued: Iterable[str], now: float) -> List[str]:
        """Those goals that the robot pursues although they are lost or cancelled, and that are to be cancelled now."""
        self._pursued = list(pursued)
        found = [goal for goal in self._pursued if self._unwanted.get(goal, now + 1.0) <= now]
        for goal in found:
            self._unwanted[goal] = now + CANCEL_PERIOD
        return found

    def _give_up(self, goal: str, due: float) -> None:
        """A goal is to be cancelled from a time on, where the robot pursues it."""
        self._unwanted[goal] = due
        if len(self._unwanted) > MAX_GOALS:
            self._unwanted.popitem(last=False)

    def poll(self, now: float) -> Optional[str]:
        """A goal that is lost now; None: there is none until `deadline`."""
        for goal, until in self._until.items():
            if until <= now:
                del self._until[goal]
                self._give_up(goal, now)
                return goal
        return None

    def deadline(self) -> Optional[float]:
        """When the next goal is lost; None: all were heard of."""
        return min(self._until.values(), default=None)
