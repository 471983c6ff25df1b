# SPDX-License-Identifier: BSD-3-Clause
"""A camera that pans, and the quality of what the operator sees of it."""
from typing import Dict, List, Optional, Tuple

import numpy as np

from smokebot_udp.arrays import UInt8Array

from .quality import psnr, ssim

WIDTH, HEIGHT = 320, 240
PAN = 8
"""Speed at which the camera pans [pixel per image]."""

GREY = 128
"""Grey level of the display before the first image."""

SSIM_PERIOD = 4
"""SSIM is slow: it is computed of every fourth image."""


def clip(photograph: UInt8Array, count: int) -> List[UInt8Array]:
    """Images of a camera that pans over a photograph: (HEIGHT, WIDTH) each."""
    return [np.ascontiguousarray(photograph[:, PAN * i:PAN * i + WIDTH]) for i in range(count)]


class Display:
    """Shows the last image that arrived, and compares it with what the camera sees at that time."""

    def __init__(self) -> None:
        self.shown = [np.full((HEIGHT, WIDTH), GREY, np.uint8)]
        self._new: List[bool] = []
        self._psnr: List[float] = []
        self._ssim: List[float] = []

    def show(self, image: Optional[UInt8Array], truth: UInt8Array) -> None:
        """Take the next image.

        :param image: (HEIGHT, WIDTH) as it arrived; None: it did not
        :param truth: (HEIGHT, WIDTH) as the camera sees it
        """
        self._new.append(image is not None)
        self.shown.append(self.shown[-1] if image is None else image)
        self._psnr.append(psnr(truth, self.shown[-1]))
        if len(self._psnr) % SSIM_PERIOD == 0:
            self._ssim.append(ssim(truth, self.shown[-1]))

    def row(self) -> Dict[str, float]:
        """The averages, for a CSV file."""
        return {'PSNR [dB]': round(float(np.mean(self._psnr)), 3), 'SSIM': round(float(np.mean(self._ssim)), 4),
                'new pictures [%]': 100 * float(np.mean(self._new))}

    def typical(self) -> Tuple[UInt8Array, float, bool]:
        """The image of median quality, its PSNR [dB], and whether it was new."""
        at = int(np.argsort(self._psnr, kind='stable')[len(self._psnr) // 2])
        return self.shown[at + 1], self._psnr[at], self._new[at]
