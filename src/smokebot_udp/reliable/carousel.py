# SPDX-License-Identifier: BSD-3-Clause
"""Many small states of several sources that are reported again and again, such as diagnostics: which are sent next.

A state whose level has changed goes at once. The others take turns, those with other values first, as often as a small
part of the link allows. A state that is reported no more ends, and the other side is told so.

The receiver keeps the states (Kept), and shows all of them as long as any come: whoever reads them, reads them whole.
"""
import collections
import math
from typing import Any, Callable, Dict, Generic, List, OrderedDict, Sequence, TypeVar

State = TypeVar('State')

INTERVAL = 1.0
"""Time from one batch to the next, where no level changes. Sources report once a second [s]."""

REFRESH = 8.0
"""A state that stays the same is sent again after this time [s]."""

LIFE_SIGN = 2.0
"""Something is sent at least this often, for the receiver's ALIVE [s]."""

MAX_DEBT, MAX_NEW_DEBT = 20.0, 10.0
"""Levels that change may use what the link allows in the first of these times in advance, states that were not sent yet
in the second one [s]."""

ENDED_AFTER = 10.0
"""A state that was not reported for this long has ended [s]."""

MAX_STATES = 512
"""States that are remembered; further ones are left out."""

OVERHEAD = 100
"""What a batch takes besides its data [byte]."""

ALIVE = 5.0
"""Without a batch for this long the receiver no longer shows the states [s]."""

KEPT_FOR = 60.0
"""The receiver forgets a state that was not sent for this long, as its end may have been lost [s]."""


class _State:
    """What is known of a state, and what was sent of it."""
    __slots__ = ('data', 'level', 'reported', 'ended', 'sent_data', 'sent_level', 'sent')

    def __init__(self) -> None:
        self.data, self.level, self.reported, self.ended = b'', 0, 0.0, False
        self.forget()

    def forget(self) -> None:
        """It has to be sent again."""
        self.sent_data, self.sent_level, self.sent = b'', -1, -math.inf

    @property
    def new(self) -> bool:
        return self.sent_level < 0

    @property
    def urgent(self) -> bool:
        return self.level != self.sent_level or self.ended


class Carousel:
    """Decides for one peer. Times are by a steady clock [s].

    :param end: f(name) -> the data that tell the peer that a state has ended
    """

    def __init__(self, end: Callable[[str], bytes]) -> None:
        self._end = end
        self._states: Dict[str, _State] = {}
        self._next = self._last = -math.inf     # when the link has room for a batch; when the last one was taken

    def put(self, name: str, level: int, data: bytes, now: float) -> None:
        """A source reports a state.

        :param level: how serious it is
        """
        if name not in self._states and len(self._states) >= MAX_STATES:
            return
        state = self._states.setdefault(name, _State())
        state.level, state.data, state.reported, state.ended = level, data, now, False

    def renew(self) -> None:
        """The peer may not have got what was sent."""
        for state in self._states.values():
            state.forget()

    def take(self, rate: float, size: Callable[[Sequence[bytes]], int], room: int, now: float) -> List[bytes]:
        """The states to send now together; empty: none.

        :param rate: what all may take, on average [byte/s]
        :param size: f(data of states) -> what they take in a message [byte]
        :param room: for data in a datagram [byte]
        """
        self._find_ended(now)
        chosen: List[_State] = []
        taken = 0
        for state in self._order(now):
            larger = size([one.data for one in chosen] + [state.data])
            if chosen and larger > max(room, rate * INTERVAL):
                break
            chosen.append(state)
            taken = larger
        if chosen:
            self._next, self._last = max(self._next, now) + (taken + OVERHEAD) / rate, now
        for state in chosen:
            state.sent_data, state.sent_level, state.sent = state.data, state.level, now
        data = [state.data for state in chosen]
        self._states = {name: state for name, state in self._states.items()
                        if not (state.ended and state.sent == now)}
        return data

    def _order(self, now: float) -> List[_State]:
        """The states that may be sent now, the most urgent first."""
        states, debt = list(self._states.values()), self._next - now
        urgent = sorted((one for one in states if one.urgent and debt <= (MAX_NEW_DEBT if one.new else MAX_DEBT)),
                        key=lambda one: one.new)
        rest = sorted((state for state in states if not state.urgent), key=lambda state: state.sent)
        due = [state for state in rest if state.data != state.sent_data or now - state.sent >= REFRESH]
        if now >= max(self._next, self._last + INTERVAL) and due:
            return urgent + due
        return urgent + rest[:now - self._last >= LIFE_SIGN]

    def _find_ended(self, now: float) -> None:
        for name, state in self._states.items():
            if not state.ended and now - state.reported > ENDED_AFTER:
                state.data, state.ended = self._end(name), True


class Kept(Generic[State]):
    """The receiving side: what is known of all states. Times are by a steady clock [s]."""

    def __init__(self) -> None:
        self._states: OrderedDict[str, Any] = collections.OrderedDict()     # {name: (state, when it came)}
        self._came = -math.inf

    def put(self, name: str, state: State, now: float) -> None:
        """A state came."""
        self._came = now
        if name in self._states or len(self._states) < MAX_STATES:
            self._states[name] = state, now

    def end(self, name: str, now: float) -> None:
        """A state has ended."""
        self._came = now
        self._states.pop(name, None)

    def clear(self) -> None:
        """The sender is another one."""
        self._states.clear()
        self._came = -math.inf

    def states(self, now: float) -> List[State]:
        """All that are in force now, in the order in which they came first; none where nothing came for ALIVE."""
        if now - self._came > ALIVE:
            return []
        for name in [name for name, (_, came) in self._states.items() if now - came > KEPT_FOR]:
            del self._states[name]
        return [state for state, _ in self._states.values()]
