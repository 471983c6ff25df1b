# SPDX-License-Identifier: BSD-3-Clause
"""The robot's half of the settings across the link: serves each request once, and decides which state is sent when.

Answers go first. A part that changed is sent at once, and again and again because datagrams get lost, less and less
often, so that every operator has all of them in the end.
"""
import collections
import math
from typing import Any, Counter, Deque, Dict, Mapping, Optional, Sequence, Tuple

from ..budget import Budget
from ..newest import Newest
from .remote import FOCUS_PART, MAX_TEXT, PartState, Request

INTERVAL = 0.05
"""Time between two states, at least [s]."""

FIRST_REPEAT, LAST_REPEAT = 1.0, 64.0
"""A part is repeated after the first time where it changed, or an operator joined, and after twice the time before, up
to the last one: four states in 10 s, of which one arrives with 99.8 % at 20 % loss. Later there is one in a minute,
0.6 kbit/s with the default streams [s]."""

MAX_REMEMBERED = 64
"""Number of requests that are remembered, to serve each once; and of answers that wait."""

BURST, REQUEST_PERIOD = 20, 0.1
"""Number of requests that are carried out at once, and the time to one more [s]. Others are dropped; operators repeat
theirs."""


class _Part:
    def __init__(self) -> None:
        self.values: Dict[str, Any] = {}
        self.revision = 0
        self.renew()

    def renew(self) -> None:
        """It is due at once."""
        self.due, self._interval = -math.inf, FIRST_REPEAT

    def sent(self, now: float) -> None:
        self.due = now + self._interval
        self._interval = min(2 * self._interval, LAST_REPEAT)


class SettingsServer:
    """Decides for one robot. All times are by one steady clock [s].

    :param session: see PartState
    :param profiles: the names of the profiles of the mission focus
    """

    def __init__(self, session: int, profiles: Sequence[str]) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """{reason: count} of the requests that were not served."""
        self._session, self._profiles = session, tuple(profiles)
        self._parts: Dict[str, _Part] = {}
        self._served: Newest[int, Tuple[str, str]] = Newest(MAX_REMEMBERED)     # {id: refusal, changes}
        self._answers: Deque[Request] = collections.deque(maxlen=MAX_REMEMBERED)
        self._sent = -math.inf
        self._budget = Budget(BURST, REQUEST_PERIOD)

    def update(self, parts: Mapping[str, Mapping[str, Any]]) -> None:
        """Take over the present values; those that differ are sent.

        :param parts: {part: {setting: requested value}}
        """
        for name, values in parts.items():
            part = self._parts.setdefault(name, _Part())
            if not part.revision or part.values != values:
                part.values = dict(values)
                part.revision += 1
                part.renew()

    def joined(self) -> None:
        """Send all parts: there is a new operator."""
        for part in self._parts.values():
            part.renew()

    def take(self, request: Request, now: float) -> bool:
        """Take a request.

        :return: whether it has to be carried out, and then be given to `answer`
        """
        if request.id in self._served:
            self._answers.append(request)
            return False
        if request.id == 0 or request.part not in self._parts:
            self.dropped['unknown part' if request.id else 'no id'] += 1
            return False
        if not self._budget.take(now):
            self.dropped['too many'] += 1
            return False
        return True

    def answer(self, request: Request, refusal: str, changes: str = '') -> None:
        """A request has been carried out, and `update` been called since; or it was refused.

        :param refusal: why; empty: it was not
        :param changes: what it has changed, in words
        """
        self._served[request.id] = refusal[:MAX_TEXT], changes[:MAX_TEXT]
        self._answers.append(request)

    def deadline(self) -> Optional[float]:
        """When `poll` returns a state next; None: not before `update`."""
        if not self._parts:
            return None
        due = -math.inf if self._answers else min(part.due for part in self._parts.values())
        return max(due, self._sent + INTERVAL)

    def poll(self, now: float) -> Optional[PartState]:
        """The state that is to be sent now."""
        due = self.deadline()
        if due is None or now < due:
            return None
        self._sent = now
        if self._answers:
            request = self._answers.popleft()
            return self._state(request.part, request.id, *self._served.get(request.id, ('', '')))
        name, part = min(self._parts.items(), key=lambda item: item[1].due)
        part.sent(now)
        return self._state(name)

    def _state(self, name: str, request: int = 0, refusal: str = '', changes: str = '') -> PartState:
        part = self._parts[name]
        return PartState(self._session, part.revision, name, part.values,
                         self._profiles if name == FOCUS_PART else (), request, refusal, changes)
