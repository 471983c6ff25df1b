# SPDX-License-Identifier: BSD-3-Clause
"""Which tiles leave next: those that an operator lacks, the changed and the near ones first, until they are reported.

    made(), gone()      the tiles of the map change
    attend(), held()    operators come and go, and report what they hold
    due(), sent()       what is to leave now, in order

Times are by a steady clock [s]. Silent operators get everything again and again, slowly. No operator, whatever it
reports, gets more than the pace of the stream allows, which is not decided here.
"""
import math
from dataclasses import dataclass, field
from typing import Collection, Dict, Iterable, List, NamedTuple, Optional, Tuple

from ...codecs.tiles.rectangle import Rectangle
from ..held import Holding
from .copies import Pattern

SILENCE = 6.0
"""What an operator held is forgotten after this time without a report [s]."""

HEAD = 175
"""Of a segment on the air, about [byte]."""

Focus = Optional[Tuple[float, float]]
"""Column and row on the lattice that are of most interest; None: none."""


class Item(NamedTuple):
    """A datagram of cells."""
    revision: int
    """Unique; the higher, the newer."""
    place: Rectangle
    data: bytes
    urgent: bool
    """Whether it shows a change of what was sent before."""


@dataclass
class _Operator:
    since: float
    """When it came, or reported last [s]."""
    lacks: Dict[int, int]
    """{revision: copies sent since it is known to be lacking}"""
    reported: bool = field(default=False)
    """Whether any report came since it came, or was forgotten."""


class TileQueue:
    """The tiles of one session, and which operators lack which of them."""

    def __init__(self) -> None:
        self._items: Dict[int, Item] = {}
        self._sent: Dict[int, float] = {}           # when a copy left last [s]
        self._operators: Dict[str, _Operator] = {}

    # -- the map -------------------------------------------------------------------------------------

    def add(self, items: Iterable[Item]) -> None:
        """Tiles were made: all operators lack them."""
        for item in items:
            self._items[item.revision] = item
            for operator in self._operators.values():
                operator.lacks[item.revision] = 0

    def remove(self, revisions: Iterable[int]) -> None:
        """Tiles are not in use any more."""
        for revision in revisions:
            del self._items[revision]
            self._sent.pop(revision, None)
            for operator in self._operators.values():
                operator.lacks.pop(revision, None)

    # -- the operators -------------------------------------------------------------------------------

    def attend(self, names: Collection[str], now: float) -> bool:
        """Set who receives the tiles now; others are forgotten, and so is what a silent one held.

        :return: whether somebody is new
        """
        newcomers = [name for name in names if name not in self._operators]
        self._operators = {name: operator for name, operator in self._operators.items() if name in names}
        for name in newcomers:
            self._operators[name] = _Operator(now, dict.fromkeys(self._items, 0))
        for operator in self._operators.values():
            if operator.reported and now - operator.since > SILENCE:
                operator.reported, operator.lacks = False, {**dict.fromkeys(self._items, 0), **operator.lacks}
        return bool(newcomers)

    def held(self, name: str, holding: Optional[Holding], now: float) -> None:
        """Take an operator's report, in place of its last one.

        :param holding: None: it holds nothing of this session
        """
        operator = self._operators.get(name)
        if operator is None:
            return
        operator.since, operator.reported = now, True
        held = set() if holding is None else _among(holding, sorted(self._items))
        operator.lacks = {revision: operator.lacks.get(revision, 0) for revision in self._items if revision not in held}

    def lacking(self) -> List[Item]:
        """The tiles that any operator may lack."""
        revisions = set().union(*(operator.lacks for operator in self._operators.values()))
        return [item for revision, item in self._items.items() if revision in revisions]

    def wanted(self, now: float) -> int:
        """Size on the air of what operators lack who report, or who came just now [byte]."""
        revisions = set().union(*(operator.lacks for operator in self._operators.values() if _hears(operator, now)))
        return sum(len(self._items[revision].data) + HEAD for revision in revisions)

    # -- what leaves ---------------------------------------------------------------------------------

    def due(self, now: float, pattern: Pattern, focus: Focus) -> List[Item]:
        """What is to leave now, in order: what was never sent first, of it what changed, then what is near; then what
        waits for longest."""
        when = self._when(now, pattern)
        due = [self._items[revision] for revision, at in when.items() if at <= now]
        return sorted(due, key=lambda item: (
            item.revision in self._sent, not item.urgent, self._sent.get(item.revision, 0.0),
            _distance(item.place, focus), item.revision))

    def next(self, now: float, pattern: Pattern) -> float:
        """When something is due next; infinite: not before something changes."""
        return min(self._when(now, pattern).values(), default=math.inf)

    def sent(self, item: Item, now: float) -> None:
        """A copy leaves now."""
        self._sent[item.revision] = now
        for operator in self._operators.values():
            if item.revision in operator.lacks:
                operator.lacks[item.revision] += 1

    def _when(self, now: float, pattern: Pattern) -> Dict[int, float]:
        """{revision: when its next copy is due} of all that is lacking."""
        when: Dict[int, float] = {}
        for operator in self._operators.values():
            hears = _hears(operator, now)
            for revision, tries in operator.lacks.items():
                at = -math.inf
                if revision in self._sent and (tries or not hears):
                    interval = pattern.interval(tries, self._items[revision].urgent) if hears else pattern.slow
                    at = self._sent[revision] + interval
                when[revision] = min(when.get(revision, math.inf), at)
        return when


def _hears(operator: _Operator, now: float) -> bool:
    """Whether an operator reports; one who came just now gets the benefit of the doubt."""
    return now - operator.since <= SILENCE


def _among(holding: Holding, revisions: List[int]) -> Collection[int]:
    """The revisions that are held."""
    return {revision for revision in revisions if holding.contains(revision)}


def _distance(place: Rectangle, focus: Focus) -> float:
    """Of a rectangle from a point [cell]; 0: the point is in it, or there is none."""
    if focus is None:
        return 0.0
    across = max(place.column - focus[0], 0.0, focus[0] - (place.column + place.width))
    along = max(place.row - focus[1], 0.0, focus[1] - (place.row + place.height))
    return math.hypot(across, along)
