# SPDX-License-Identifier: BSD-3-Clause
"""Which parts of a message were received."""
from typing import Optional

import numpy as np

from ...arrays import IntArray


class ReceivedParts:
    """The parts of one message, as far as they were received.

    :param count: number of parts of the whole message, at least 1
    :param order: (count,) int, the parts in the order in which they are sent; None: by number
    """

    def __init__(self, count: int, order: Optional[IntArray] = None) -> None:
        self.have = np.zeros(count, bool)
        """(count,) bool: those received."""
        self._order: IntArray = np.arange(count) if order is None else order
        self._places: IntArray = np.empty(count, int)
        self._places[self._order] = np.arange(count)

    @property
    def complete(self) -> bool:
        """Whether all parts were received."""
        return bool(self.have.all())

    @property
    def completeness(self) -> float:
        """Ratio of the parts received, 0..1."""
        return float(np.count_nonzero(self.have)) / len(self.have)

    @property
    def awaited(self) -> int:
        """The place of the missing part that is sent last; not to be asked where all were received."""
        return int(np.flatnonzero(~self.have[self._order])[-1])

    def places(self, numbers: IntArray) -> IntArray:
        """The places of some parts in the order in which they are sent.

        :param numbers: (m,) int, of these parts
        :return: (m,) int, from 0 on; -1: there is no such part
        """
        there = (numbers >= 0) & (numbers < len(self.have))
        places: IntArray = np.where(there, self._places[np.where(there, numbers, 0)], -1)
        return places
