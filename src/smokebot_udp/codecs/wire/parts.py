# SPDX-License-Identifier: BSD-3-Clause
"""Which parts of a message were received."""
import numpy as np


class ReceivedParts:
    """The parts of one message, as far as they were received.

    :param count: number of parts of the whole message, at least 1
    """

    def __init__(self, count: int) -> None:
        self.have = np.zeros(count, bool)
        """(count,) bool: those received."""

    @property
    def complete(self) -> bool:
        """Whether all parts were received."""
        return bool(self.have.all())

    @property
    def completeness(self) -> float:
        """Ratio of the parts received, 0..1."""
        return float(np.count_nonzero(self.have)) / len(self.have)
