# SPDX-License-Identifier: BSD-3-Clause
"""How many bytes of an image are worth the time they take: an image on the screen shows what was, and the scene moves.

The squared error on the screen is that of the coding, which falls with each byte, and that of the motion since, which
grows with the age of the image, and so with each byte that is on the air before it is complete.
"""
import math
from collections import deque
from typing import Deque, Optional, Tuple

import numpy as np

from ...arrays import Array, FloatArray, IntArray, UInt8Array

SAMPLED = 4
"""Every fourth row and column is compared."""

SMOOTHING = 0.3
"""Weight of the newest measurement."""

SHARP_BITS, SHARP_RATIO = 0.5, 10 ** (-36 / 20)
"""However fast the scene moves, an image is sharp, because a blurred one is of no use, whatever its error: with so many
bits a value, or where its rms error is this part of its contrast;"""

SHARP_TIME, POOR_BITS = 0.04, 0.1
"""but where that takes longer than this, it has only what takes so long, and at least this [s, bit per value]."""

USUAL = 5, 95
"""Between these percentiles are the values that contrast is measured by: a fire is none of them."""

SPREAD = 3.29
"""The distance between them in standard deviations, of normally distributed values."""

SIGNIFICANCE = 3.0
"""Growth is motion where it is larger than this many of its standard deviations, and else noise."""

MAX_GAP = 1.0
"""Images that are farther apart are not compared [s]."""


class MotionMeter:
    """Measures how fast the images of a stream become outdated."""

    def __init__(self) -> None:
        self.growth = 0.0
        """Of the mean squared difference from the scene, without noise [count^2/s]."""
        self._last: Deque[Tuple[float, Array]] = deque(maxlen=2)

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
            self.growth = 0.0
        if len(self._last) == 2:
            (first, earlier), (second, later) = self._last
            growths = np.square(image - earlier) - np.square(image - later)
            growth, deviation = np.nansum(growths) / growths.size, np.sqrt(np.nansum(np.square(growths))) / growths.size
            found = float(growth) / (second - first) if growth > SIGNIFICANCE * deviation else 0.0
            self.growth += SMOOTHING * (found - self.growth)
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


def contrast_of(pixels: Array) -> float:
    """The standard deviation of an image's usual values [count].

    :param pixels: (height, width) or (height, width, channels)
    """
    low, high = np.percentile(pixels[::SAMPLED, ::SAMPLED], USUAL)
    return float(high - low) / SPREAD


def sharp_size(ends: IntArray, errors: FloatArray, duration: float, cells: int, contrast: float) -> float:
    """The bytes that are sent however fast the scene moves; see `worth_sending`."""
    enough = np.flatnonzero(errors <= cells * (SHARP_RATIO * contrast) ** 2)
    sharp = min(SHARP_BITS / 8 * cells, float(ends[enough[0]]) if len(enough) else math.inf)
    return min(sharp, max(POOR_BITS / 8 * cells, SHARP_TIME / duration))


def worth_sending(ends: IntArray, errors: FloatArray, growth: float, duration: float, cells: int,
                  contrast: float) -> int:
    """The number of truncation points up to the one with the least error on the screen, of several the last one: where
    nothing moves the whole stream is worth sending, also if its last bytes happen to change no pixel.

    :param ends: (s,) truncation points of a stream [byte]
    :param errors: (s,) sums of squared errors there
    :param growth: of the sum of squared errors with age [1/s]
    :param duration: of a byte of the stream until it is on the screen [s], > 0
    :param cells: number of values of the image
    :param contrast: see contrast_of [count]
    """
    first = min(int(np.searchsorted(ends, sharp_size(ends, errors, duration, cells, contrast))), len(ends) - 1)
    return len(ends) - int(np.argmin((errors + growth * duration * ends)[first:][::-1]))
