# SPDX-License-Identifier: BSD-3-Clause
"""Pixels and planes: by hand, odd sizes, colours there and back."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import UInt8Array
from smokebot_udp.codecs.video.planes import ENCODINGS, from_planes, to_planes


def test_an_odd_grey_image_repeats_its_border() -> None:
    image = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], np.uint8)
    assert to_planes(image, 'mono8').tolist() == [[1, 2, 3, 3], [4, 5, 6, 6], [7, 8, 9, 9], [7, 8, 9, 9]]


def test_white_and_blue_of_bt_601() -> None:
    # white: Y 16 + 219, no chroma; blue 255: Y 16 + 24.97, Cb 128 + 112, Cr 128 - 18.2
    white, blue = np.full((2, 2, 3), 255, np.uint8), np.zeros((2, 2, 3), np.uint8)
    blue[..., 0] = 255
    assert to_planes(white, 'bgr8').tolist() == [[235, 235], [235, 235], [128, 128]]
    assert to_planes(blue, 'bgr8').tolist() == [[41, 41], [41, 41], [240, 110]]
    assert to_planes(blue[..., ::-1], 'rgb8').tolist() == to_planes(blue, 'bgr8').tolist()


@given(st.sampled_from(ENCODINGS), st.integers(1, 9), st.integers(1, 9), st.integers(0, 255), st.integers(0, 255))
@settings(deadline=None)
def test_there_and_back(encoding, height, width, one, other) -> None:
    shape = (height, width) if encoding == 'mono8' else (height, width, 3)
    image: UInt8Array = np.full(shape, one, np.uint8)
    if image.ndim == 3:
        image[..., 1] = other
        image[..., 2] = (one + other) // 2
    planes = to_planes(image, encoding)
    assert planes.flags.c_contiguous and planes.shape[1] % 2 == 0
    back = from_planes(planes, height, width, encoding)
    assert back.shape == shape
    assert np.abs(back.astype(int) - image).max() <= (0 if encoding == 'mono8' else 3)


def test_luma_of_a_colour_image_is_a_grey_one() -> None:
    planes = np.arange(18, dtype=np.uint8).reshape(6, 3)[:, [0, 1, 2, 2]]
    assert from_planes(planes, 4, 3, 'mono8').tolist() == np.arange(12).reshape(4, 3).tolist()


@pytest.mark.parametrize('shape', [(5, 4), (6, 6), (2, 4), (6, 3)])
def test_planes_of_another_size(shape) -> None:
    with pytest.raises(ValueError, match='are not those of an image of 4 x 4'):
        from_planes(np.zeros(shape, np.uint8), 4, 4, 'bgr8')


def test_encodings_without_planes() -> None:
    with pytest.raises(ValueError, match="'mono16' has no planes"):
        to_planes(np.zeros((2, 2), np.uint8), 'mono16')
