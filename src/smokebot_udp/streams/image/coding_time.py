# SPDX-License-Identifier: BSD-3-Clause
"""How long coding takes, and how much of an image is worth coding where that takes longer than the air.

Time in the processors counts like time on the air: the scene moves on meanwhile. What the next image is worth is
foreseen from the last one, because what was coded too much has taken its time.
"""
import math
from typing import Callable

CELL_TIME, BYTE_TIME = 15e-9, 100e-9
"""Coding takes this for each cell and each byte of the stream on a usual processor; decoding the same [s]."""

SMOOTHING = 0.2
"""Weight of the newest measurement."""

SPARE = 1.25
"""The next image is coded up to this many times the bytes that were worth sending of the last one,"""

GROWTH = 2.0
"""or this many times where all that was coded was worth sending."""


class CodingTime:
    """Measures how long coding takes.

    :param clock: steady [s]
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._factor = clock, 0.0
        self._began = 0.0
        self.prediction = 0.0
        """Of predicting an image, smoothed [s]."""

    @property
    def per_byte(self) -> float:
        """Of a byte of the stream, on both sides [s]."""
        return 2 * BYTE_TIME * self._factor

    def begin(self) -> None:
        """Something begins."""
        self._began = self._clock()

    def coded(self, cells: int, size: int) -> None:
        """An image of `cells` was coded into a stream of `size` bytes since `begin`."""
        factor = (self._clock() - self._began) / (CELL_TIME * cells + BYTE_TIME * size)
        self._factor = _smoothed(self._factor, factor)

    def predicted(self) -> None:
        """An image was predicted since `begin`."""
        self.prediction = _smoothed(self.prediction, self._clock() - self._began)


class Foreseen:
    """What the stream of the next image may take, after the last one."""

    def __init__(self) -> None:
        self.size = math.inf
        """[byte]"""

    def sent(self, worth: int, coded: int, whole: bool) -> None:
        """An image was coded.

        :param worth: what was worth sending of it [byte]
        :param coded: its stream [byte]
        :param whole: whether the stream would not have been longer with more time
        """
        if worth < coded:
            self.size = SPARE * worth
        else:
            self.size = math.inf if whole else GROWTH * coded


def _smoothed(mean: float, newest: float) -> float:
    return mean + SMOOTHING * (newest - mean) if mean else newest
