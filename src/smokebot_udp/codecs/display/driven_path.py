# SPDX-License-Identifier: BSD-3-Clause
"""Where a robot has driven: positions that are evenly apart, of a bounded number."""
import math
from typing import List, Sequence, Tuple

from ...frame_names import frame_name

Position = Tuple[float, float, float]
"""(x, y, z) [m]"""

MAX_POSITIONS = 1000
SPACING = 0.1
"""Between two positions, until there are too many [m]."""

MAX_STEP = 3.0
"""After a longer step the path begins anew: the odometry was reset, or another robot speaks [m]."""


class DrivenPath:
    """Collects positions. Where there are too many, every second one is left out from then on.

    :param max_positions: at least 2
    """

    def __init__(self, max_positions: int = MAX_POSITIONS, spacing: float = SPACING) -> None:
        self._max, self._first_spacing = max_positions, spacing
        self._spacing = spacing
        self._frame = ''
        self._positions: List[Position] = []

    @property
    def positions(self) -> Sequence[Position]:
        """From the first to the newest."""
        return tuple(self._positions)

    def add(self, frame: str, position: Position) -> bool:
        """Take a position; returns whether the path differs now.

        :param frame: of the positions; another one begins a new path
        """
        if not all(map(math.isfinite, position)):
            return False
        frame = frame_name(frame)
        if frame != self._frame or self._positions and math.dist(position, self._positions[-1]) > max(
                MAX_STEP, 2 * self._spacing):
            self._frame, self._positions, self._spacing = frame, [], self._first_spacing
        if self._positions and math.dist(position, self._positions[-1]) < self._spacing:
            return False
        if len(self._positions) >= self._max:
            self._positions, self._spacing = self._positions[::2], 2 * self._spacing
        self._positions.append(position)
        return True
