# SPDX-License-Identifier: BSD-3-Clause
"""The robot's clock: all times of the report are by it, as the stamps are."""
from typing import Mapping

import numpy as np

from ..arrays import FloatArray


class RobotClock:
    """Converts the operator's times.

    :param offsets: {time by the operator's clock: the robot's clock minus the operator's} [s]; empty: unknown, they are
        taken for the same
    """

    def __init__(self, offsets: Mapping[float, float]) -> None:
        self._times = np.array(sorted(offsets))
        self._offsets = np.array([offsets[time] for time in sorted(offsets)])

    @property
    def is_known(self) -> bool:
        return len(self._times) > 0

    @property
    def median(self) -> float:
        """The median offset [s]; 0: unknown."""
        return float(np.median(self._offsets)) if self.is_known else 0.0

    def of_operator(self, times: FloatArray) -> FloatArray:
        """The operator's times by the robot's clock, (n,) [s]: between estimates the offset is interpolated."""
        return times + np.interp(times, self._times, self._offsets) if self.is_known else times
