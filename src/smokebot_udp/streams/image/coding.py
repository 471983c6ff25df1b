# SPDX-License-Identifier: BSD-3-Clause
"""What the ways of coding have in common, and layered images and video: any number of bytes makes an image there, and
the link says how many."""
import math
from typing import Any, ClassVar, List, NamedTuple, Optional

from ...congestion.operating_points import OperatingPoint, layered_points, with_late
from ...mission.settings import Settings
from ...udpros.frame import Frame
from ..encoder import LinkView
from .image_size import LATEST, LEAST_BYTES, Bound, Grant

SIZE_STEP = 2 ** 0.25
"""Sizes of complete images are rounded up to powers of this: operating points change rarely."""


class Coded(NamedTuple):
    """An image as it is sent."""
    frames: List[Frame]
    bound: Bound
    """What decided its size."""
    error: float = math.nan
    """As Sizing.error."""
    base: int = 1
    """As Encoded.base."""


class Coding:
    """A way of coding images. `encode` is called by one thread, `operating_points` by any."""
    CODING: ClassVar[str] = ''
    """As the setting names it."""
    coding_time = 0.0
    """Expected for the next image [s]."""

    def encode(self, message: Any, settings: Settings, link: LinkView, granted: Grant, began: float) -> Coded:
        """As Encoder.encode.

        :param granted: what a compressed image may take
        :param began: when its coding began, by a steady clock [s]
        """
        raise NotImplementedError

    def backlog(self, link: LinkView) -> Optional[float]:
        """As Encoded.backlog [s]."""
        return None

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        """As Encoder.operating_points."""
        raise NotImplementedError


class CompressedImages(Coding):
    """What an image takes on the air. A way of coding derives from it, and notes the sizes."""
    def __init__(self) -> None:
        self._size: Optional[float] = None  # of a complete image on the air [byte]
        self._fair_size = 0.0               # of a fair image on the air [byte]

    def backlog(self, link: LinkView) -> Optional[float]:
        return LATEST       # without its rest much of an image is lost that has come

    def _note_size(self, size: float) -> None:
        """Note what a complete image takes on the air [byte]."""
        self._size = SIZE_STEP ** math.ceil(math.log(max(size, LEAST_BYTES), SIZE_STEP))

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        if self._size is None:
            return []
        size = min(self._size, settings.requested['max_bytes'] or self._size)
        return with_late(layered_points(rate, size, settings.requested['degradation_preference'], self._fair_size,
                                        LEAST_BYTES, 1 / LATEST), 1 / LATEST)
