# SPDX-License-Identifier: BSD-3-Clause
"""How much the images of a stream resemble the ones before."""
from collections import deque
from statistics import median
from typing import Deque, Optional

import numpy as np

from ...arrays import Array

COMPARED = 9
"""The median of this many images counts."""

SAMPLED = 8
"""Every eighth row and column is compared."""


class Similarity:
    """Compares each image with the one before."""

    def __init__(self) -> None:
        self._last: Optional[Array] = None
        self._variance = 0.0
        self._differences: Deque[float] = deque(maxlen=COMPARED)

    def add(self, pixels: Array) -> None:
        """Take the next image; one of another shape begins anew.

        :param pixels: (height, width) or (height, width, channels) uint8
        """
        image, last = pixels[::SAMPLED, ::SAMPLED].astype(np.float32), self._last
        self._last, self._variance = image, float(image.var())
        if last is None or last.shape != image.shape:
            self._differences.clear()
        else:
            self._differences.append(float(np.square(image - last).mean()))

    @property
    def difference(self) -> Optional[float]:
        """Mean squared difference of two successive images [count^2]; None: there were none."""
        return median(self._differences) if self._differences else None

    @property
    def ratio(self) -> Optional[float]:
        """The same in terms of that of two independent images, 0 for a standing scene; None: too few were compared."""
        if len(self._differences) <= COMPARED // 2:
            return None
        return median(self._differences) / max(2 * self._variance, 1e-9)
