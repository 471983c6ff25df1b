# SPDX-License-Identifier: BSD-3-Clause
"""Image quality: PSNR and SSIM as scikit-image defines them."""
from typing import Optional

import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from smokebot_udp.arrays import Array

MAX_PSNR = 60.0
"""Higher values count as this one: the difference is invisible, and an exact image has no finite PSNR [dB]."""


def psnr(truth: Array, shown: Array, value_range: Optional[float] = None) -> float:
    """The peak signal-to-noise ratio, at most MAX_PSNR [dB].

    :param truth, shown: (height, width) images of one dtype
    :param value_range: from the smallest to the largest possible value; None: that of the dtype
    """
    with np.errstate(divide='ignore'):
        return min(MAX_PSNR, float(peak_signal_noise_ratio(truth, shown, data_range=value_range)))


def ssim(truth: Array, shown: Array) -> float:
    """The structural similarity; 1: the same image.

    :param truth, shown: (height, width) uint8
    """
    return float(structural_similarity(truth, shown))
