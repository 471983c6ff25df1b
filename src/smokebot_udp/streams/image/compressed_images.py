# SPDX-License-Identifier: BSD-3-Clause
"""What layered images and video have in common: any number of bytes makes an image, and the link says how many."""
import math
from typing import ClassVar, List, Optional

from ...congestion.operating_points import OperatingPoint, layered_points
from ...mission.settings import Settings
from .image_size import LATEST, LEAST_BYTES, Bound

SIZE_STEP = 2 ** 0.25
"""Sizes of complete images are rounded up to powers of this: operating points change rarely."""


class CompressedImages:
    """What an image takes on the air, and may take. A way of coding derives from it, and notes the sizes."""
    CODING: ClassVar[str]
    """As the setting names it."""
    BACKLOG = LATEST
    """As Encoder.backlog: without the rest of an image much of it is lost that has come [s]."""
    error = math.nan
    """As Sizing.error."""
    bound = Bound.ROOM
    """What decided the size of the last image."""
    coding_time = 0.0
    """Expected for the next image [s]."""

    def __init__(self) -> None:
        self._size: Optional[float] = None  # of a complete image on the air [byte]
        self._fair_size = 0.0               # of a fair image on the air [byte]
        self.base = 1
        """As Encoder.base."""

    def _note_size(self, size: float) -> None:
        """Note what a complete image takes on the air [byte]."""
        self._size = SIZE_STEP ** math.ceil(math.log(max(size, LEAST_BYTES), SIZE_STEP))

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        """As Encoder.operating_points."""
        if self._size is None:
            return []
        size = min(self._size, settings.requested['max_bytes'] or self._size)
        return layered_points(rate, size, settings.requested['degradation_preference'], self._fair_size, LEAST_BYTES,
                              1 / LATEST)
