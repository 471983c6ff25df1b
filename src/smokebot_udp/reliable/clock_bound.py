# SPDX-License-Identifier: BSD-3-Clause
"""The least that another node's clock can show now, from the times at which it sent its messages."""
import math

WINDOW = 60.0
"""Clocks drift apart: what is older than two windows is forgotten once there is something newer [s]."""


class ClockBound:
    """A lower bound of another node's steady clock; it is low by the time that the fastest message took."""

    def __init__(self) -> None:
        self._begun = -math.inf     # of the window
        self._offset = self._before = -math.inf     # in this window, in the one before

    def add(self, sent: float, now: float) -> None:
        """A message came.

        :param sent: when, by the other clock [s]
        """
        if now - self._begun > WINDOW:
            self._begun, self._before, self._offset = now, self._offset, -math.inf
        self._offset = max(self._offset, sent - now)

    def at(self, now: float) -> float:
        """The least that the other clock shows at a time of this one [s]; -infinity: unknown."""
        return now + max(self._offset, self._before)
