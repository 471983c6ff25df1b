# SPDX-License-Identifier: BSD-3-Clause
"""How fast the images of a stream become outdated."""
from collections import deque
from typing import Deque, Optional, Tuple

import numpy as np

from ...arrays import Array, UInt8Array

SAMPLED = 4
"""Every fourth row and column is compared."""

MEASURED = 2.0
"""Motion is the mean of what was measured for this long: a scene that stands for a moment has images like the others,
and one that stands for longer becomes exact [s]."""

SIGNIFICANCE = 3.0
"""Growth is motion where it is larger than this many of its standard deviations, and else noise."""

MAX_GAP = 1.0
"""Images that are farther apart are not compared [s]."""


class MotionMeter:
    """Measures how fast the images of a stream become outdated."""

    def __init__(self) -> None:
        self.growth = 0.0
        """Growth of the mean squared difference from the scene, without noise [count^2/s]."""
        self._last: Deque[Tuple[float, Array]] = deque(maxlen=2)
        self._found: Deque[Tuple[float, float]] = deque()      # (stamp, growth)

    def add(self, pixels: Array, stamp: float, classes: Optional[UInt8Array] = None) -> None:
        """Compare an image with the two before, where all three are finite; elsewhere they count as alike.

        Noise is in both differences alike, so what the farther one is larger by is motion.

        :param pixels: (height, width) or (height, width, channels)
        :param stamp: its time [s]
        :param classes: (height, width), 0: finite; None: all are
        """
        image = pixels[::SAMPLED, ::SAMPLED].astype(np.float32)
        if classes is not None:
            image[classes[::SAMPLED, ::SAMPLED] > 0] = np.nan
        if self._last and (self._last[-1][1].shape != image.shape or not 0 < stamp - self._last[-1][0] < MAX_GAP):
            self._last.clear()
            self._found.clear()
            self.growth = 0.0
        if len(self._last) == 2:
            (first, earlier), (second, later) = self._last
            growths = np.square(image - earlier) - np.square(image - later)
            growth, deviation = np.nansum(growths) / growths.size, np.sqrt(np.nansum(np.square(growths))) / growths.size
            found = float(growth) / (second - first) if growth > SIGNIFICANCE * deviation else 0.0
            self._found.append((stamp, found))
            while self._found[0][0] <= stamp - MEASURED:
                self._found.popleft()
            self.growth = sum(growth for _, growth in self._found) / len(self._found)
        self._last.append((stamp, image))


class Repeats:
    """Counts how many images in a row show exactly what the one before does: nothing moves, and there is no noise."""

    def __init__(self) -> None:
        self.count = 0
        self._last: Tuple[Optional[Array], Optional[UInt8Array]] = None, None

    def add(self, pixels: Array, classes: Optional[UInt8Array] = None) -> None:
        """Take the next image; parameters as of MotionMeter.add. It must not be changed later."""
        repeated = _same(pixels, self._last[0]) and _same(classes, self._last[1])
        self.count, self._last = self.count + 1 if repeated else 0, (pixels, classes)


def _same(one: Optional[Array], other: Optional[Array]) -> bool:
    return one is other if one is None or other is None else bool(np.array_equal(one, other))
