# SPDX-License-Identifier: BSD-3-Clause
"""How far what a video shows is from its original: the error of its coding, and what losses add.

The robot says the first with each image. The second is estimated at the operator: a part that is missing shows the
image before, and so is as wrong as the scene has changed since. That stays in the images that are predicted from it,
until the part is coded anew.
"""
import collections
import statistics
from typing import Deque, Optional

import numpy as np

from ...arrays import UInt8Array

SAMPLED = 8
"""Every eighth row and column is compared with the last image's, on both sides."""

MEASURED = 10
"""How fast the scene changes is the median of what was measured of so many images: where a part comes again after a
loss the image differs from the one before by more. Of a slowly flying camera (752 x 480, 10 Hz) and a swaying one
(320 x 240) the estimated PSNR is 0 dB from the true one without losses, 0.5 and 0.3 dB at 5 % loss that was not
expected, -2.2 and -0.4 dB at 20 %, and 0.5 and -0.3 dB where the robot protects images against that (means)."""

UNKNOWN_CHANGE = 100.0
"""Mean squared difference of two successive images before it is measured [count^2]."""

NO_IMAGE = 2000.0
"""Mean squared error of what stands for a part that was never received, or for a lost image that was not predicted:
there is nothing to take its place [count^2]."""

COMPARED = 0.5
"""Images of which a smaller share came do not say how fast the scene changes: most of them is the image before."""


class VideoError:
    """Follows the images that are decoded of one stream, in their order."""

    def __init__(self) -> None:
        self._damage = NO_IMAGE                     # mean squared error that losses have added [count^2]
        self._changes: Deque[float] = collections.deque(maxlen=MEASURED)    # mean squared, of successive images
        self._last: Optional[UInt8Array] = None

    def begin(self) -> None:
        """The next image follows nothing that is known."""
        self._damage, self._last = NO_IMAGE, None

    def add(self, pixels: UInt8Array, share: float, lost: int, intra: bool, refresh: int) -> float:
        """The mean squared error that losses have added to an image [count^2].

        :param pixels: as decoded
        :param share: of its slices that came, 0..1
        :param lost: images between the one before and this one
        :param intra: whether it is not predicted from others
        :param refresh: all parts are coded anew within so many images
        """
        self._compare(pixels[::SAMPLED, ::SAMPLED], share, lost)
        if intra and refresh > 1:       # otherwise none is predicted, and the one before takes the place
            self._damage = (1 - share) * NO_IMAGE
            return self._damage
        change = statistics.median(self._changes) if self._changes else UNKNOWN_CHANGE
        # what is coded anew replaces what was wrong there; of lost images nothing was
        self._damage *= 1 - share / refresh
        self._damage += (lost + 1 - share) * change
        return self._damage

    def _compare(self, image: UInt8Array, share: float, lost: int) -> None:
        last, self._last = self._last, image.copy()
        if last is None or last.shape != image.shape or share < COMPARED:
            return
        self._changes.append(float(np.square(image.astype(np.float32) - last).mean()) / (share * (lost + 1)))
