# SPDX-License-Identifier: BSD-3-Clause
"""PSNR and SSIM against their definitions."""
import numpy as np
import pytest

pytest.importorskip('skimage')

from evaluation.quality import MAX_PSNR, psnr, ssim  # noqa: E402


def test_psnr() -> None:
    black = np.zeros((2, 2), np.uint8)
    assert psnr(black, black) == MAX_PSNR
    assert psnr(black, black + 255) == 0
    assert psnr(black, black + 51) == pytest.approx(13.98, abs=0.01)
    assert psnr(black, black + 51, value_range=51) == pytest.approx(0)


def test_ssim_of_the_same_image_is_1() -> None:
    image = np.random.RandomState(1).randint(0, 256, (16, 16)).astype(np.uint8)
    assert ssim(image, image) == pytest.approx(1)
    assert ssim(image, 255 - image) < 0
