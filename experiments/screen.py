# SPDX-License-Identifier: BSD-3-Clause
"""A camera that moves, and how good it is what the operator sees of it."""
import numpy as np
from skimage.metrics import structural_similarity

from benchmarks.pictures import psnr

WIDTH, HEIGHT = 320, 240
PAN = 8
"""[pixel a picture]"""

GREY = 128
LOOKED_AT = 4
"""SSIM takes long: only of each so manieth picture."""


def clip(photograph, count):
    """[(HEIGHT, WIDTH) uint8, ...] pictures of a camera that pans."""
    return [np.ascontiguousarray(photograph[:, PAN * i:PAN * i + WIDTH]) for i in range(count)]


class Screen:
    """What the operator sees, and how good it is on average."""

    def __init__(self):
        self.shown = [np.full((HEIGHT, WIDTH), GREY, np.uint8)]
        self._new, self._psnr, self._ssim = [], [], []

    def show(self, picture, truth):
        """:param picture: that came, or None"""
        self._new.append(picture is not None)
        self.shown.append(self.shown[-1] if picture is None else picture)
        self._psnr.append(psnr(truth, self.shown[-1]))
        if len(self._psnr) % LOOKED_AT == 0:
            self._ssim.append(structural_similarity(truth, self.shown[-1]))

    def row(self):
        return {'PSNR [dB]': round(np.mean(self._psnr), 3), 'SSIM': round(np.mean(self._ssim), 4),
                'new pictures [%]': 100 * np.mean(self._new)}

    def typical(self):
        """What was shown when it was as good as half of the time: the picture, its PSNR [dB], whether it was new."""
        at = np.argsort(self._psnr, kind='stable')[len(self._psnr) // 2]
        return self.shown[at + 1], self._psnr[at], self._new[at]
