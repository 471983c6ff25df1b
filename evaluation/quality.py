# SPDX-License-Identifier: BSD-3-Clause
"""Image quality: PSNR and SSIM as scikit-image defines them."""
import math
from typing import Optional

import cv2
import numpy as np
from skimage.metrics import structural_similarity

from smokebot_udp.arrays import Array

MAX_PSNR = 60.0
"""Higher values count as this one: the difference is invisible, and an exact image has no finite PSNR [dB]."""


def psnr(truth: Array, shown: Array, value_range: Optional[float] = None) -> float:
    """The peak signal-to-noise ratio, at most MAX_PSNR [dB].

    :param truth, shown: images of one shape and dtype
    :param value_range: from the smallest to the largest possible value; None: that of the dtype, of integers
    """
    peak = np.iinfo(truth.dtype).max if value_range is None else value_range
    error = cv2.norm(truth, shown, cv2.NORM_L2SQR) / truth.size
    return MAX_PSNR if not error else min(MAX_PSNR, 10 * math.log10(peak ** 2 / error))


def ssim(truth: Array, shown: Array) -> float:
    """The structural similarity; 1: the same image.

    :param truth, shown: (height, width) uint8
    """
    return float(structural_similarity(truth, shown))
