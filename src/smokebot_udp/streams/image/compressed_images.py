# SPDX-License-Identifier: BSD-3-Clause
"""What layered images and video have in common: any number of bytes makes an image, and the link says how many."""
import math
from typing import Any, ClassVar, Dict, List, Mapping, Optional

from ...congestion.operating_points import OperatingPoint, layered_points, with_more_bytes
from ...mission.settings import Settings
from ..frame_assembler import MAX_WAIT
from ..outlook import Outlook

LEAST_BYTES = 600
"""Of an image on the air: a datagram that is of use [byte]."""

SIZE_STEP = 2 ** 0.25
"""Sizes of complete images are rounded up to powers of this: operating points change rarely."""


class CompressedImages:
    """What an image takes on the air, and may take. A way of coding derives from it, and notes the sizes."""
    AIR_PART: ClassVar[float]
    """An image takes this part of the time that it is granted on the air."""

    def __init__(self) -> None:
        self._size: Optional[float] = None  # of a complete image on the air [byte]
        self._fair_size = 0.0               # of a fair image on the air [byte]
        self.base = 1
        """As Encoder.base."""

    @property
    def _least_rate(self) -> float:
        """An image leaves within its part of the period of this rate at what its stream may use of the link, however
        rare images are: its last datagrams come long before the operator stops waiting for them, also where the link is
        slower than expected [Hz]."""
        return 1 / (MAX_WAIT / 2)

    def _note_size(self, size: float) -> None:
        """Note what a complete image takes on the air [byte]."""
        self._size = SIZE_STEP ** math.ceil(math.log(max(size, LEAST_BYTES), SIZE_STEP))

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        """As Encoder.operating_points."""
        if self._size is None:
            return []
        size = min(self._size, settings.requested['max_bytes'] or self._size)
        return layered_points(rate, size, settings.requested['degradation_preference'], self._fair_size, LEAST_BYTES,
                              self._least_rate)

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        """As Encoder.refine."""
        return with_more_bytes(point, spare, self._size or 0.0, self._least_rate)

    def budget(self, settings: Settings, outlook: Outlook) -> float:
        """What the link has for an image on the air, as granted [byte]; inf: more than any image takes."""
        granted = (settings.granted or {}).get('max_bytes') or math.inf
        return float(min(settings.requested['max_bytes'] or math.inf, self.AIR_PART * granted, outlook.in_air_time(
            settings, self.AIR_PART / max(settings['rate'], self._least_rate))))
