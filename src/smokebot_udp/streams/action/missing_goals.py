# SPDX-License-Identifier: BSD-3-Clause
"""Goals whose results have not come although they ended, or left the status of the robot's action server.

The server lists a goal for some seconds after its end. After a cut the newest status may arrive without the goal and
before its result, which is sent again: a client of actionlib would take the goal for lost. So it stays listed, as it
was last, for as long as its result may still come. A result that was published while robot_sender was being restarted
never comes: a client would wait for it for ever, and is to be told.
"""
import collections
from typing import Any, Container, Dict, List, Mapping, NamedTuple, OrderedDict

from ...newest import Newest
from .goal_watch import MAX_GOALS

LOSS_TIMEOUT = 10.0
"""Time for which a result is waited for [s]."""

MAX_STEP = 1.5
"""Time that counts between two statuses, at most: during a cut nothing can come [s]."""


class Missing(NamedTuple):
    """What follows from a status."""
    added: List[Any]
    """What is to be added to it, for goals that it lacks."""
    lost: List[str]
    """Goals whose results will not come."""


class MissingGoals:
    """Follows goals by their ids. The clock is an argument [s, any steady clock]."""

    def __init__(self) -> None:
        self._listed: OrderedDict[str, Any] = collections.OrderedDict()    # the last statuses of goals without results
        self._since: Dict[str, float] = {}      # when each ended, or left, by the time below
        self._ended: Newest[str, None] = Newest(MAX_GOALS)     # goals with results
        self._time = 0.0        # during which statuses came
        self._last = 0.0

    def ended(self, goal: str) -> None:
        """The result of a goal has come."""
        self._ended[goal] = None
        self._forget(goal)

    def update(self, statuses: Mapping[str, Any], final: Container[str], now: float) -> Missing:
        """A status has come.

        :param statuses: {goal: what it says of it}
        :param final: goals of which it says that they ended
        """
        self._time += min(max(now - self._last, 0.0), MAX_STEP)
        self._last = now
        for goal, status in statuses.items():
            if goal not in self._ended:
                self._listed[goal] = status
        while len(self._listed) > MAX_GOALS:
            self._forget(next(iter(self._listed)))
        missing = [goal for goal in self._listed if goal not in statuses]
        lost = self._overdue([*missing, *(goal for goal in self._listed if goal in statuses and goal in final)])
        return Missing([self._listed[goal] for goal in missing if goal in self._listed], lost)

    def _overdue(self, waiting: List[str]) -> List[str]:
        """Those of the goals that wait for a result which have waited too long."""
        self._since = {goal: self._since.get(goal, self._time) for goal in waiting}
        lost = [goal for goal, since in self._since.items() if self._time - since >= LOSS_TIMEOUT]
        for goal in lost:
            self.ended(goal)
        return lost

    def _forget(self, goal: str) -> None:
        self._listed.pop(goal, None)
        self._since.pop(goal, None)
