# SPDX-License-Identifier: BSD-3-Clause
"""How long coding takes: time in the processors counts like time on the air, as the scene moves on meanwhile."""
CELL_TIME, BYTE_TIME = 15e-9, 100e-9
"""Coding takes this for each cell and each byte of the stream on a usual processor; decoding the same [s]."""

SMOOTHING = 0.2
"""Weight of the newest measurement."""


class CodingTime:
    """Means of how long coding took."""

    def __init__(self) -> None:
        self._factor = 0.0
        self.prediction = 0.0
        """Mean time to predict an image [s]."""
        self.image = 0.0
        """Mean time for all that is done for an image [s]."""

    @property
    def per_byte(self) -> float:
        """Time to code and decode a byte of the stream [s]."""
        return 2 * BYTE_TIME * self._factor

    def coded(self, cells: int, size: int, duration: float) -> None:
        """An image of `cells` was coded into a stream of `size` bytes."""
        self._factor = _smoothed(self._factor, duration / (CELL_TIME * cells + BYTE_TIME * size))

    def predicted(self, duration: float) -> None:
        """An image was predicted."""
        self.prediction = _smoothed(self.prediction, duration)

    def done(self, duration: float) -> None:
        """An image was made into datagrams."""
        self.image = _smoothed(self.image, duration)


def _smoothed(mean: float, newest: float) -> float:
    return mean + SMOOTHING * (newest - mean) if mean else newest
