# SPDX-License-Identifier: BSD-3-Clause
import math

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from smokebot_udp.nodes.demo_report import psnr


@pytest.mark.parametrize('shape', [(40, 60), (40, 60, 3)])
def test_psnr_of_bytes(shape: tuple) -> None:
    random = np.random.RandomState(0)
    sent, received = (random.randint(0, 256, shape).astype(np.uint8) for _ in range(2))
    assert psnr(sent, received) == pytest.approx(peak_signal_noise_ratio(sent, received))
    assert psnr(sent, sent) == math.inf


def test_psnr_of_counts_is_over_the_range_of_the_sent_image() -> None:
    sent = np.array([[7000, 8000], [9000, 7500]], np.uint16)
    assert psnr(sent, sent + np.uint16(20)) == pytest.approx(20 * math.log10(2000 / 20))
