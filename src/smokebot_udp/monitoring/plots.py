# SPDX-License-Identifier: BSD-3-Clause
"""Sparklines of numbers over the last minute. Time is an argument: seconds of a monotonic clock."""
from typing import Dict, Hashable, Optional

BARS = '▁▂▃▄▅▆▇█'
ASCII_BARS = '_.:-=+*#'

SPAN = 60.0
"""How long numbers are kept [s]."""

SLOTS = 20
"""In SPAN."""

MAX_SERIES = 2048
"""Further series of numbers are not kept."""


class Plots:
    """The sparklines of the numbers of a table. Without `begin` there are none.

    :param bars: signs, ascending
    """

    def __init__(self, bars: str = BARS) -> None:
        self._bars = bars
        self.width = 0
        """Width of each sparkline, including the space before it [characters]; 0: there are no sparklines."""
        self._slot = 0
        self._series: Dict[Hashable, Dict[int, float]] = {}     # {key: {slot: greatest number}}

    def begin(self, bars: int, now: float) -> None:
        """Begin a table; numbers older than SPAN are forgotten.

        :param bars: of each sparkline: a divisor of SLOTS; 0: there are none
        """
        self._slot, self.width = int(now // (SPAN / SLOTS)), bars + 1 if bars else 0
        kept = ((key, {slot: number for slot, number in series.items() if slot > self._slot - SLOTS})
                for key, series in self._series.items())
        self._series = {key: series for key, series in kept if series}

    def line(self, key: Hashable, number: Optional[float]) -> str:
        """Take a number, None is unknown; its sparkline, with a space before it.

        Each bar is the greatest number of its part of SPAN, from 0 to the greatest of all; a space where none is known.
        A negative number, such as an age by clocks that differ, is shown as 0.
        """
        if not self.width:
            return ''
        if number is not None and (key in self._series or len(self._series) < MAX_SERIES):
            series = self._series.setdefault(key, {})
            series[self._slot] = max(number, series.get(self._slot, 0.0))
        series = self._series.get(key, {})
        greatest, size = max(series.values(), default=0.0), SLOTS // (self.width - 1)
        signs = ' '
        for begin in range(self._slot - SLOTS + 1, self._slot + 1, size):
            part = [series[slot] for slot in range(begin, begin + size) if slot in series]
            share = max(part) / greatest if part and greatest else 0.0
            signs += self._bars[round(share * (len(self._bars) - 1))] if part else ' '
        return signs
