# SPDX-License-Identifier: BSD-3-Clause
"""The robot's half of the settings across the link: serves each request once, and decides which state is sent when.

Answers go first, then the parts that changed, each several times because datagrams get lost. Otherwise one part after
the other is sent, slowly, so that every operator has all of them in the end.
"""
import collections
import itertools
import math
from typing import Any, Counter, Deque, Dict, Iterator, Mapping, Optional, OrderedDict, Sequence, Tuple

from ..budget import Budget
from .remote import FOCUS_PART, MAX_REFUSAL, PartState, Request

PERIOD = 0.3
"""Time from one state to the next where nothing changes [s]."""

INTERVAL = 0.05
"""Time between states that answer or have changed [s]."""

SENDINGS = 2
"""How often a part is sent after a change, or after an operator joined."""

MAX_REMEMBERED = 64
"""Number of requests that are remembered, to serve each once; and of answers that wait."""

BURST, REQUEST_PERIOD = 20, 0.1
"""Number of requests that are carried out at once, and the time to one more [s]. Others are dropped; operators repeat
theirs."""


class _Part:
    def __init__(self, values: Mapping[str, Any]) -> None:
        self.values = dict(values)
        self.revision = 1


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
        self._turn: Iterator[str] = itertools.cycle(())     # of the parts
        self._urgent: OrderedDict[str, int] = collections.OrderedDict()     # {part: how often it is still to be sent}
        self._served: OrderedDict[int, str] = collections.OrderedDict()     # {id: why it was refused}
        self._answers: Deque[Tuple[Request, str]] = collections.deque(maxlen=MAX_REMEMBERED)
        self._sent = -math.inf
        self._budget = Budget(BURST, REQUEST_PERIOD)

    def update(self, parts: Mapping[str, Mapping[str, Any]]) -> None:
        """Take over the present values; those that differ are sent.

        :param parts: {part: {setting: requested value}}
        """
        for name, values in parts.items():
            known = self._parts.get(name)
            if known is None:
                self._parts[name] = _Part(values)
                self._turn = itertools.cycle(tuple(self._parts))
            elif known.values != values:
                known.values = dict(values)
                known.revision += 1
            else:
                continue
            self._urgent[name] = SENDINGS

    def joined(self) -> None:
        """Send all parts: there is a new operator."""
        self._urgent.update(dict.fromkeys(self._parts, SENDINGS))

    def take(self, request: Request, now: float) -> bool:
        """Take a request.

        :return: whether it has to be carried out, and then be given to `answer`
        """
        if request.id in self._served:
            self._answers.append((request, self._served[request.id]))
            return False
        if request.id == 0 or request.part not in self._parts:
            self.dropped['unknown part' if request.id else 'no id'] += 1
            return False
        if not self._budget.take(now):
            self.dropped['too many'] += 1
            return False
        return True

    def answer(self, request: Request, refusal: str) -> None:
        """A request has been carried out, and `update` been called since; or it was refused.

        :param refusal: why; empty: it was not
        """
        self._served[request.id] = refusal = refusal[:MAX_REFUSAL]
        while len(self._served) > MAX_REMEMBERED:
            self._served.popitem(last=False)
        self._answers.append((request, refusal))

    def deadline(self) -> Optional[float]:
        """When `poll` returns a state next; None: not before `update`."""
        if not self._parts:
            return None
        return self._sent + (INTERVAL if self._answers or self._urgent else PERIOD)

    def poll(self, now: float) -> Optional[PartState]:
        """The state that is to be sent now."""
        due = self.deadline()
        if due is None or now < due:
            return None
        self._sent = now
        if self._answers:
            request, refusal = self._answers.popleft()
            return self._state(request.part, request.id, refusal)
        return self._state(self._next_urgent() if self._urgent else next(self._turn))

    def _next_urgent(self) -> str:
        """A part that is to be sent soon; the others come before it is sent again."""
        name, left = self._urgent.popitem(last=False)
        if left > 1:
            self._urgent[name] = left - 1
        return name

    def _state(self, name: str, request: int = 0, refusal: str = '') -> PartState:
        part = self._parts[name]
        return PartState(self._session, part.revision, name, part.values,
                         self._profiles if name == FOCUS_PART else (), request, refusal)
