# SPDX-License-Identifier: BSD-3-Clause
"""Which tiles leave next: those that an operator lacks, the changed and the near ones first, until they are reported.

    made(), gone()      the tiles of the map change
    attend(), held()    operators come and go, and report what they hold
    due(), sent()       what is to leave now, in order

Times are by a steady clock [s]. Silent operators get everything again and again, slowly. No operator, whatever it
reports, gets more than the pace of the stream allows, which is not decided here.

Rows of arrays are tiles: a large map has thousands of them, and they are looked at fifty times a second.
"""
from dataclasses import dataclass, field
from typing import Collection, Dict, Iterable, List, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array, BoolArray, IntArray
from ...codecs.tiles.rectangle import Rectangle
from ..held import Holding
from .copies import Pattern

SILENCE = 6.0
"""What an operator held is forgotten after this time without a report [s]."""

HEAD = 175
"""Size of a segment on the air without its data, about [byte]."""

MOST_TRIES = 400
"""Number of copies of a tile after which the interval between them is the longest one."""

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
    lacks: BoolArray
    """(n,): the tiles that it lacks."""
    tries: IntArray
    """(n,): copies sent since a tile is known to be lacking."""
    reported: bool = field(default=False)
    """Whether any report came since it came, or was forgotten."""

    def hears(self, now: float) -> bool:
        """Whether it reports; one who came just now gets the benefit of the doubt."""
        return now - self.since <= SILENCE

    def lack(self, lacks: BoolArray) -> None:
        """Set what it lacks."""
        self.tries[~self.lacks] = 0
        self.lacks = lacks


class TileQueue:
    """The tiles of one session, and which operators lack which of them."""

    def __init__(self) -> None:
        self._items: List[Item] = []                    # (n), by revision, as all of these
        self._revisions: IntArray = np.zeros(0, np.int64)
        self._urgent: BoolArray = np.zeros(0, bool)
        self._sizes: IntArray = np.zeros(0, np.int64)   # on the air [byte]
        self._places: Array = np.zeros((0, 4))          # column, row, width, height [cell]
        self._sent: Array = np.zeros(0)                 # when a copy left last; NaN: never [s]
        self._operators: Dict[str, _Operator] = {}

    # -- the map -------------------------------------------------------------------------------------

    def add(self, items: Collection[Item]) -> None:
        """Tiles were made, newer ones than all before: all operators lack them."""
        if not items:
            return
        self._items += items
        count = len(items)
        self._revisions = np.append(self._revisions, [item.revision for item in items])
        self._urgent = np.append(self._urgent, [item.urgent for item in items])
        self._sizes = np.append(self._sizes, [len(item.data) + HEAD for item in items])
        self._places = np.concatenate([self._places, np.array([item.place for item in items], float)])
        self._sent = np.append(self._sent, np.full(count, np.nan))
        for operator in self._operators.values():
            operator.lacks = np.append(operator.lacks, np.ones(count, bool))
            operator.tries = np.append(operator.tries, np.zeros(count, np.int64))

    def remove(self, revisions: Collection[int]) -> None:
        """Tiles are not in use any more."""
        if not revisions:
            return
        kept = ~np.isin(self._revisions, list(revisions))
        self._items = [item for item, stays in zip(self._items, kept.tolist()) if stays]
        self._revisions, self._urgent, self._sizes = self._revisions[kept], self._urgent[kept], self._sizes[kept]
        self._places, self._sent = self._places[kept], self._sent[kept]
        for operator in self._operators.values():
            operator.lacks, operator.tries = operator.lacks[kept], operator.tries[kept]

    # -- the operators -------------------------------------------------------------------------------

    def attend(self, names: Collection[str], now: float) -> bool:
        """Set who receives the tiles now; others are forgotten, and so is what a silent one held.

        :return: whether somebody is new
        """
        newcomers = [name for name in names if name not in self._operators]
        self._operators = {name: operator for name, operator in self._operators.items() if name in names}
        for name in newcomers:
            self._operators[name] = _Operator(now, self._all(), np.zeros(len(self._items), np.int64))
        for operator in self._operators.values():
            if operator.reported and not operator.hears(now):
                operator.reported = False
                operator.lack(self._all())
        return bool(newcomers)

    def held(self, name: str, holding: Optional[Holding], now: float) -> None:
        """Take an operator's report, in place of its last one.

        :param holding: None: it holds nothing of this session
        """
        operator = self._operators.get(name)
        if operator is None:
            return
        operator.since, operator.reported = now, True
        operator.lack(self._all() if holding is None else ~holding.among(self._revisions))

    def lacking(self) -> List[Item]:
        """The tiles that any operator may lack."""
        return self._of(self._lacked(self._operators.values()))

    def wanted(self, now: float) -> int:
        """Size on the air of what operators lack who report, or who came just now [byte]."""
        return int(self._sizes[self._lacked(operator for operator in self._operators.values() if operator.hears(now))
                               ].sum())

    # -- what leaves ---------------------------------------------------------------------------------

    def due(self, now: float, pattern: Pattern, focus: Focus) -> List[Item]:
        """What is to leave now, in order: what was never sent first, of it what changed, then what is near; then what
        waits for longest."""
        rows = np.flatnonzero(self._when(now, pattern) <= now)
        sent = self._sent[rows]
        order = np.lexsort((self._revisions[rows], _distances(self._places[rows], focus), np.nan_to_num(sent),
                            ~self._urgent[rows], ~np.isnan(sent)))
        return [self._items[row] for row in rows[order].tolist()]

    def next(self, now: float, pattern: Pattern) -> float:
        """When something is due next; infinite: not before something changes."""
        return float(self._when(now, pattern).min(initial=np.inf))

    def sent(self, item: Item, now: float) -> None:
        """A copy leaves now."""
        row = int(np.searchsorted(self._revisions, item.revision))
        self._sent[row] = now
        for operator in self._operators.values():
            operator.tries[row] += operator.lacks[row]

    def _when(self, now: float, pattern: Pattern) -> Array:
        """(n,): when the next copy of each tile is due; infinite: nobody lacks it [s]."""
        when = np.full(len(self._items), np.inf)
        for operator in self._operators.values():
            if operator.hears(now):
                waits = ~np.isnan(self._sent) & (operator.tries > 0)
                intervals = _intervals(pattern, operator.tries, self._urgent)
            else:
                waits, intervals = ~np.isnan(self._sent), np.full(len(when), pattern.slow)
            at = np.where(waits, self._sent + intervals, -np.inf)
            np.minimum(when, at, out=when, where=operator.lacks)
        return when

    def _all(self) -> BoolArray:
        return np.ones(len(self._items), bool)

    def _lacked(self, operators: Iterable[_Operator]) -> BoolArray:
        """(n,): the tiles that any of some operators lacks."""
        lacked = np.zeros(len(self._items), bool)
        for operator in operators:
            lacked |= operator.lacks
        return lacked

    def _of(self, rows: BoolArray) -> List[Item]:
        return [self._items[row] for row in np.flatnonzero(rows).tolist()]


def _intervals(pattern: Pattern, tries: IntArray, urgent: BoolArray) -> Array:
    """(n,): Pattern.interval of each tile [s]."""
    tries = np.minimum(tries, MOST_TRIES)
    counts = range(1, int(tries.max(initial=0)) + 1)
    table = np.array([[0.0, *(pattern.interval(count, hurry) for count in counts)] for hurry in (False, True)])
    intervals: Array = table[urgent.astype(int), tries]
    return intervals


def _distances(places: Array, focus: Focus) -> Array:
    """(n,): of rectangles from a point [cell]; 0: the point is in it, or there is none.

    :param places: (n, 4): column, row, width, height
    """
    if focus is None:
        return np.zeros(len(places))
    first, last = places[:, :2], places[:, :2] + places[:, 2:]
    beside = np.maximum(np.maximum(first - focus, focus - last), 0.0)
    distances: Array = np.hypot(beside[:, 0], beside[:, 1])
    return distances
