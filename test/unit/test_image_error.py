# SPDX-License-Identifier: BSD-3-Clause
import math

import pytest

from smokebot_udp.image_error import EIGHT_BITS, ImageError


@pytest.mark.parametrize('error, text', [
    (ImageError(2.55, EIGHT_BITS), '40 dB'), (ImageError(25.5, EIGHT_BITS), '20 dB'),
    (ImageError(255.0, EIGHT_BITS), '0 dB'), (ImageError(0.0, EIGHT_BITS), 'exact'),
    (ImageError(0.0, None, 25.0, 'K'), 'exact'),
    (ImageError(4.5), '+-4.5 counts'), (ImageError(0.012), '+-0.012 counts'), (ImageError(52.3), '+-52 counts'),
    (ImageError(9.96), '+-10 counts'), (ImageError(1234.0), '+-1234 counts'), (ImageError(2e6), '+-2e+06 counts'),
    (ImageError(4.5, None, 25.0, 'degC'), '+-0.18 degC'), (ImageError(0.02, None, 1.0, 'm'), '+-0.02 m')])
def test_texts(error: ImageError, text: str) -> None:
    assert str(error) == text


def test_psnr_is_relative_to_a_range() -> None:
    assert ImageError(2.0).psnr(200.0) == pytest.approx(40.0) and ImageError(2.0).psnr(2.0) == 0.0
    assert ImageError(0.0).psnr(0.0) == math.inf and ImageError(1.0).psnr(0.0) == 0.0
