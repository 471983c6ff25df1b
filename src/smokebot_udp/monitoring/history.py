# SPDX-License-Identifier: BSD-3-Clause
"""Numbers over the last minute, and sparklines of them. Time is an argument: seconds of a monotonic clock."""
import collections
from typing import Deque, Dict, Generic, Hashable, List, Mapping, Optional, Sequence, Tuple, TypeVar

BARS = '▁▂▃▄▅▆▇█'
ASCII_BARS = '_.:-=+*#'

SPAN = 60.0
"""How long numbers are kept [s]."""

MAX_SERIES = 2048
"""Further series of numbers are not kept."""

K = TypeVar('K', bound=Hashable)


class History(Generic[K]):
    """Series of numbers by key, in slots of the same duration; of each slot the last number counts.

    :param slots: number of slots in SPAN
    """

    def __init__(self, slots: int = 20) -> None:
        self._slots = slots
        self._series: Dict[K, Deque[Tuple[int, float]]] = {}     # (slot, number), the newest last

    def add(self, numbers: Mapping[K, Optional[float]], now: float) -> None:
        """Add the numbers of a moment; None is unknown. Series without a number for SPAN are forgotten."""
        slot = self._slot(now)
        for key, number in numbers.items():
            if number is None or (key not in self._series and len(self._series) >= MAX_SERIES):
                continue
            series = self._series.setdefault(key, collections.deque(maxlen=self._slots))
            if series and series[-1][0] == slot:
                series.pop()
            series.append((slot, number))
        self._series = {key: series for key, series in self._series.items() if series[-1][0] > slot - self._slots}

    def series(self, key: K, now: float) -> List[Optional[float]]:
        """The numbers of the last SPAN, the oldest first; None where none is known."""
        known = dict(self._series.get(key, ()))
        last = self._slot(now)
        return [known.get(slot) for slot in range(last - self._slots + 1, last + 1)]

    def _slot(self, now: float) -> int:
        return int(now // (SPAN / self._slots))


def sparkline(numbers: Sequence[Optional[float]], width: int, bars: str = BARS) -> str:
    """A bar for each part of the numbers, from 0 to the greatest of them; a space where none is known.

    A negative number, such as an age by clocks that differ, is shown as 0.

    :param width: number of bars at most; each shows the greatest number of its part
    :param bars: signs, ascending
    """
    size = max(1, -(-len(numbers) // max(1, width)))
    parts = [[number for number in numbers[start:start + size] if number is not None]
             for start in range(0, len(numbers), size)]
    greatest = max((number for part in parts for number in part), default=0.0)
    top = len(bars) - 1
    return ''.join(' ' if not part else bars[round(max(0.0, max(part)) / greatest * top)] if greatest > 0 else bars[0]
                   for part in parts)
