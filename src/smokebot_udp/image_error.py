# SPDX-License-Identifier: BSD-3-Clause
"""How far an image is from its original, in the words of displays and diagnostics."""
import math
from typing import NamedTuple, Optional

EIGHT_BITS = 255.0
"""Peak value of a channel of 8 bits."""


class ImageError(NamedTuple):
    """The estimated error of an image that was coded with loss."""
    rms: float
    """Root mean square error over all cells, in the values of the pixels."""
    peak: Optional[float] = None
    """The largest value of a pixel, where the error is expressed as PSNR; None: it is expressed in units."""
    per_unit: float = 1.0
    """Values of pixels for each unit."""
    unit: str = 'counts'

    def psnr(self, span: float) -> float:
        """The ratio of a range of values to the error [dB]; infinite for an exact image, not above 0 for no range."""
        if not self.rms:
            return math.inf
        return 20 * math.log10(span / self.rms) if span > 0 else 0.0

    def __str__(self) -> str:
        if not self.rms:
            return 'exact'
        if self.peak is not None:
            return '%.0f dB' % self.psnr(self.peak)
        error = self.rms / self.per_unit
        return '+-%s %s' % ('%.0f' % error if 9.95 <= error < 1e5 else '%.2g' % error, self.unit)
