# SPDX-License-Identifier: BSD-3-Clause
"""A map that refresh cycles complete: a data carousel (FLUTE, DSM-CC), without clock or ROS (D6.3, section 5).

The robot sends a map again and again. Cells stay until another cycle brings them anew, as long as the map's place stays
the same; a map of another size or origin is a new one. The map is shown QUIET after the latest segment, or max_wait
after the first one that is not shown yet.
"""
import collections
from types import SimpleNamespace
from typing import Any, Callable, Counter, Generic, Optional, Tuple, TypeVar

import numpy as np

from .frame_assembler import RESTART, PartialFrame

QUIET = 0.1
"""After a pause of this length a cycle is over, or its rest is lost [s]."""

Map = TypeVar('Map', bound=PartialFrame)


class Carousel(Generic[Map]):
    """Sorts segments into one map.

    :param begin: f(head) -> PartialFrame, an empty map; raises ValueError if the head is impossible
    :param max_wait: may be changed at any time [s]
    """

    def __init__(self, begin: Callable[[SimpleNamespace], Map], max_wait: float) -> None:
        self.max_wait = max_wait
        self.dropped: Counter[str] = collections.Counter()
        """Segments that changed nothing, by reason: late, contradiction, impossible head."""
        self._begin = begin
        self._map: Optional[Tuple[SimpleNamespace, Any, Map]] = None    # newest head that fits, its place, the cells
        self.latest = 0.0
        """When the latest segment of the map was received [s]."""
        self._since: Optional[float] = None     # when the first segment was received that is not shown [s]

    def deadline(self) -> Optional[float]:
        """When the map is to be shown; None: nothing new was received [s]."""
        return None if self._since is None else min(self._since + self.max_wait, self.latest + QUIET)

    def poll(self, now: float) -> Optional[Tuple[SimpleNamespace, Map]]:
        """(head, map) if the map is to be shown now. Later segments are added to the same map."""
        deadline = self.deadline()
        if self._map is None or deadline is None or now < deadline:
            return None
        self._since = None
        head, _, cells = self._map
        return head, cells

    def add(self, head: SimpleNamespace, place: Any, parts: Tuple[Any, ...], now: float) -> None:
        """Take m segments of one cycle.

        :param head: the fields that they repeat; `head.stamp` is the map's [ns]
        :param place: what identifies a map; one that is equal goes on with its cells
        :param parts: arguments of PartialFrame.add; the first has length m
        :param now: by any steady clock [s]
        """
        count = len(parts[0])
        if self._is_late(head.stamp, now):
            self.dropped['late'] += count
            return
        if self._map is not None and place == self._map[1]:
            cells = self._map[2]
        else:
            try:
                cells = self._begin(head)
            except ValueError:
                self.dropped['impossible head'] += count
                return
        good = cells.add(*parts)
        self.dropped['contradiction'] += count - int(np.count_nonzero(good))
        if good.any():
            self._map = head, place, cells
            self.latest = now
            self._since = now if self._since is None else self._since

    def _is_late(self, stamp: int, now: float) -> bool:
        # only reordered segments are late: otherwise a map whose stamp never changes would always be late
        return (self._map is not None and 0 < self._map[0].stamp - stamp < RESTART * 1e9
                and now - self.latest < RESTART)
