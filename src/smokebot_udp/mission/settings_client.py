# SPDX-License-Identifier: BSD-3-Clause
"""An operator's half of the settings across the link: a copy of the robot's settings, and requests to change them.

A change takes effect in the copy at once, and is requested of the robot: one request after the other, in the order in
which they were made, since a switch of the focus resets other settings. Further changes of a part wait together: a
slider makes many. What the robot refuses, or does not answer in time, is set back to what the robot has.
"""
import collections
import dataclasses
import itertools
import math
from typing import Any, Callable, Counter, Deque, Dict, List, Mapping, Optional, Set, Tuple

from .control import FOCUS
from .parameters import Table, check_one
from .remote import FOCUS_PART, FOCUS_SETTING, PartState, Request
from .settings import SettingsStore

TIMEOUT = 10.0
"""A change that the robot does not answer for this long is given up [s]."""

MAX_WAITING = 64
"""Maximum number of changes that wait for the robot."""


Done = Callable[[str, str], None]
"""f(refusal, changes), as in PartState."""


@dataclasses.dataclass
class _Change:
    """Settings of one part that the robot has not answered yet."""
    part: str
    values: Dict[str, Any]
    until: float
    """Time at which the change is given up [s]."""
    timeout: float = TIMEOUT
    """Time that the robot has to answer; it is named when the change is given up [s]."""
    done: Optional[Done] = None
    """Called when the change is over; None: the change is in the copy already."""
    id: int = 0
    """Id of the change's request; 0: it has none yet, as it waits for the changes before it."""
    sent: bool = False
    """Whether it is on its way."""


class SettingsClient:
    """Holds the copy. All times are by one steady clock [s].

    :param tables: {stream: {setting: Parameter}} of the settings that may change while the robot runs
    """

    def __init__(self, tables: Mapping[str, Table]) -> None:
        self.stores: Dict[str, SettingsStore] = {}
        """{part: its settings}, of the parts whose state was received; only this class requests settings of them."""
        self.dropped: Counter[str] = collections.Counter()
        """{reason: count} of the states that were not used."""
        self._tables, self._ids = {**tables, FOCUS_PART: {FOCUS_SETTING: FOCUS}}, itertools.count(1)
        self._robot: Dict[str, PartState] = {}
        self._changes: Deque[_Change] = collections.deque()     # the first one is requested
        self._changed: Dict[str, None] = {}     # the parts that have changed by what the robot sent, or did not answer
        self._problems: List[Tuple[str, str]] = []
        self._unusable: Set[Tuple[str, str]] = set()    # values that were reported

    def request(self, part: str, changes: Mapping[str, Any], now: float) -> Dict[str, Any]:
        """Change settings, see SettingsStore.request.

        :param part: one of `stores`
        :raises ValueError: where a value is not allowed, or too much waits for the robot; nothing is changed then
        """
        self._check_room()
        delta = self.stores[part].request(changes)
        if delta:
            last = self._changes[-1] if self._changes else None
            if last is not None and last.part == part and not last.id and last.done is None:
                last.values.update(delta)
            else:
                self._changes.append(_Change(part, delta, now + TIMEOUT))
        return delta

    def switch(self, focus: str, timeout: float, now: float, done: Done) -> None:
        """Request a focus, also the same one: the robot resets what was changed by hand. The copy has it with the
        answer.

        :param timeout: the request is given up after this time [s]
        :raises ValueError: where too much waits for the robot
        """
        self._check_room()
        self._changes.append(_Change(FOCUS_PART, {FOCUS_SETTING: focus}, now + timeout, timeout, done))

    def receive(self, state: PartState) -> None:
        """Take a state of the robot's."""
        table = self._tables.get(state.part)
        if table is None:
            self.dropped['unknown part'] += 1
            return
        answers = bool(self._changes) and self._changes[0].id == state.request != 0 \
            and self._changes[0].part == state.part
        if answers:
            self._finish(state.refusal, state.changes)
        self._robot[state.part] = state
        self._take_over(state.part)

    def begin_again(self) -> None:
        """A session with the robot has begun: what was on its way in the one before may not have arrived."""
        if self._changes:
            self._changes[0].sent = False

    @property
    def news(self) -> bool:
        """Whether `take_news` has anything."""
        return bool(self._problems or self._changed)

    def take_news(self) -> Tuple[List[Tuple[str, str]], List[str]]:
        """([(part, problem), ...], parts that have changed other than by `request`) since the last call."""
        problems, changed = self._problems, list(self._changed)
        self._problems, self._changed = [], {}
        return problems, changed

    def deadline(self) -> Optional[float]:
        """When `poll` has something to do next; None: not before `request`."""
        if not self._changes:
            return None
        return self._changes[0].until if self._changes[0].sent else -math.inf

    def poll(self, now: float) -> Optional[Request]:
        """The request that is to be sent now; changes that the robot did not answer are given up."""
        while self._changes and self._changes[0].until <= now:
            part = self._changes[0].part
            self._finish('the robot did not answer in %g s' % self._changes[0].timeout)
            if part in self._robot:
                self._take_over(part)
        if not self._changes or self._changes[0].sent:
            return None
        change = self._changes[0]
        change.id, change.sent = change.id or next(self._ids), True
        return Request(change.id, change.part, change.values)

    def _check_room(self) -> None:
        if len(self._changes) >= MAX_WAITING:
            raise ValueError('%d changes wait for the robot already' % MAX_WAITING)

    def _finish(self, refusal: str, changes: str = '') -> None:
        """The first change was answered, or is given up."""
        change = self._changes.popleft()
        if change.done is not None:
            change.done(refusal, changes)
        elif refusal:
            self._problems.append((change.part, '%s refused: %s' % (
                ', '.join('%s %r' % item for item in sorted(change.values.items())), refusal)))

    def _take_over(self, part: str) -> None:
        """Set the copy of a part to what the robot has, but for changes that it has not answered yet."""
        values = dict(self._robot[part].values)
        for change in self._changes:
            if change.part == part and change.done is None:
                values.update(change.values)
        values = self._good(part, values)
        store = self.stores.get(part)
        if store is None:
            defaults = {name: parameter.default for name, parameter in self._tables[part].items()}
            self.stores[part] = SettingsStore(self._table(part), {**defaults, **values})
            self._changed[part] = None
            return
        store.table.update(self._table(part))
        if store.request(values):
            self._changed[part] = None

    def _table(self, part: str) -> Table:
        """The table of a part; the choices of the focus are the robot's profiles."""
        table = self._tables[part]
        if part != FOCUS_PART:
            return table
        return {name: dataclasses.replace(parameter, choices=self._robot[part].profiles)
                for name, parameter in table.items()}

    def _good(self, part: str, values: Mapping[str, Any]) -> Dict[str, Any]:
        """The values that this version knows and allows; the others are reported once."""
        good, table = {}, self._table(part)
        for name, value in values.items():
            try:
                good[name] = check_one(name, value, table)
            except ValueError as error:
                if (part, name) not in self._unusable and len(self._unusable) < MAX_WAITING:
                    self._unusable.add((part, name))
                    self._problems.append((part, "the robot's value is not shown: %s" % error))
        return good
