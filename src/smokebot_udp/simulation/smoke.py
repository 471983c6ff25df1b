# SPDX-License-Identifier: BSD-3-Clause
"""The smoke that a camera sees: it is thicker below the ceiling, and drifts in billows.

Light that passes a length d of smoke with the extinction k keeps exp(-k d) of its contrast (Beer-Lambert).
"""
from typing import Any

import cv2
import numpy as np

from ..arrays import Float32Array, FloatArray
from .pinhole import Pinhole, View

BLOCK = 16
"""Billows are computed for blocks of this side, as they have no edges [pixel]."""

SOFT = 0.3, 0.7
"""Shares of the fine billows and of the coarse ones, which are twice as large."""

DRIFT, RISE = 0.25, 0.1
"""Speeds of billows across the image [rad/s] and upwards [image height/s]."""


class Smoke:
    """:param extinction: at the camera's height, of quiet smoke [1/m]
    :param billows: deviation of the extinction within them, as a part of it, 0..1
    """

    def __init__(self, pinhole: Pinhole, extinction: float, billows: float, seed: int) -> None:
        self._extinction, self._pinhole = np.float32(extinction), pinhole
        self._rows, self._columns = -(-pinhole.height // BLOCK), -(-pinhole.width // BLOCK)
        # around the robot once, so that billows stay where they are while it turns
        around = int(np.ceil(2 * np.pi * pinhole.focal_length / BLOCK))
        noise = np.random.RandomState(seed).standard_normal((2 * self._rows, around))
        fine, coarse = (share * _smooth(noise, self._rows / 12 * size) for share, size in zip(SOFT, (1, 2)))
        field = (fine + coarse) / np.std(fine + coarse)
        self._field: Float32Array = (1 + billows * np.clip(field, -1, 1.5)).astype(np.float32)

    def clear(self, view: View, yaw: float, time: float) -> Float32Array:
        """(height, width) float32: the share of the contrast that is left, 0..1.

        :param yaw: of the camera [rad]
        :param time: [s]
        """
        optical = np.minimum(view.z, np.float32(2.7))
        optical *= np.float32(-0.5)
        optical -= np.float32(0.7)
        optical *= view.depth
        optical *= self._extinction * self._billows(yaw, time)
        return np.asarray(cv2.exp(optical, optical))

    def _billows(self, yaw: float, time: float) -> Float32Array:
        """(height, width) float32, 1 on average."""
        rows, around = self._field.shape
        x, y = -(yaw + DRIFT * time) * self._pinhole.focal_length / BLOCK, RISE * time * self._rows
        left, top = int(np.floor(x)), int(np.floor(y))
        window = self._field.take(range(top, top + self._rows + 2), axis=0, mode='wrap').take(
            range(left, left + self._columns + 2), axis=1, mode='wrap')
        enlarged = np.array([(1 / BLOCK, 0, x - left), (0, 1 / BLOCK, y - top)], np.float32)
        return np.asarray(cv2.warpAffine(
            window, enlarged, (self._pinhole.width, self._pinhole.height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE))


def _smooth(noise: FloatArray, size: float) -> FloatArray:
    """Noise without details below a size [pixel], which goes on at the opposite edge; its deviation is 1."""
    fftfreq: Any = np.fft.fftfreq       # its types differ between numpy 1 and 2
    rows, columns = map(fftfreq, noise.shape)
    kept = np.exp(-2 * (np.pi * size) ** 2 * np.add.outer(rows ** 2, columns ** 2) / 4)
    smooth = np.fft.ifft2(np.fft.fft2(noise) * kept).real
    return np.asarray(smooth / smooth.std())
