# SPDX-License-Identifier: BSD-3-Clause
"""How much two successive images of known error differ."""
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np
import pytest

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.concealment.successive import MAX_PIXELS, SuccessiveImages

HEIGHT, WIDTH, WIDE = 96, 128, 400


def texture(dtype: Any = np.uint8, contrast: float = 25.0) -> Array:
    """(HEIGHT, WIDE): a scene with detail of a few pixels everywhere."""
    random = np.random.RandomState(1)
    rows, columns = np.mgrid[:HEIGHT, :WIDE]
    waves = sum(np.sin(rows * random.uniform(-0.6, 0.6) + columns * random.uniform(-0.9, 0.9) + phase)
                for phase in range(12))
    return np.asarray((120 + contrast / 2.5 * waves).clip(0, 255), dtype)


def seen(shift: int, noise: float = 1.0, error: float = 0.0, seed: int = 0) -> Array:
    """What a noisy camera sees, coded with an error of its own."""
    random = np.random.RandomState(seed)
    view = texture()[:, shift:shift + WIDTH] + random.normal(0, noise, (HEIGHT, WIDTH))
    return np.asarray((view + random.normal(0, error, (HEIGHT, WIDTH))).round().clip(0, 255), np.uint8)


def last(images: Sequence[Tuple[Array, float]]) -> Optional[float]:
    """What is said of the last of some images, (pixels, error) each."""
    successive = SuccessiveImages()
    return [successive.changed(*image) for image in images][-1]


@pytest.mark.parametrize('errors', [(0.0, 0.0), (4.0, 4.0), (0.5, 5.0), (5.0, 0.5)])
@pytest.mark.parametrize('shift, moved', [(0, False), (1, True), (9, True)])
def test_motion_by_a_pixel_is_told_from_noise_and_from_errors(errors: Tuple[float, float], shift: int,
                                                              moved: bool) -> None:
    images = [(seen(shift * max(k - 3, 0), error=errors[k % 2], seed=k), errors[k % 2]) for k in range(6)]
    changed = last(images)
    assert changed is not None and (changed > 0.7 if moved else changed < 0.01)


def test_noise_that_a_coarse_image_hid_is_not_motion() -> None:
    smooth, noisy = (texture()[:, :WIDTH], 3.0), [(seen(0, 2.0, seed=k), 0.0) for k in range(2)]
    assert last([smooth] * 20 + noisy[:1]) == 0 and last([smooth] * 20 + noisy) == 0


def test_only_where_something_moves() -> None:
    before, after = seen(0, seed=1), seen(0, seed=2)
    after[16:48, 32:64] = 255 - after[16:48, 32:64]
    assert last([(before, 0.5), (after, 0.5)]) == pytest.approx(16 / (HEIGHT * WIDTH / 64), abs=0.005)


@pytest.mark.parametrize('pixels, rms', [
    (seen(0), 60.0), (np.full((HEIGHT, WIDTH), 7, np.uint8), 0.0), (seen(0)[:1, :1], 1.0)])
def test_nothing_is_known_where_motion_would_not_be_seen(pixels: Array, rms: float) -> None:
    assert last([(pixels, rms)] * 3) is None


def test_nothing_is_known_of_the_first_image_of_a_shape_or_type() -> None:
    image = seen(0)
    others = [image[:-8], image.astype(np.uint16), np.dstack([image] * 3), image.astype(np.float32)]
    for other in others:
        assert last([(image, 0.0), (other, 0.0)]) is None
        assert last([(image, 0.0), (other, 0.0), (other, 0.0)]) == 0


def test_depth_that_is_not_a_number_moves_too() -> None:
    depth = texture(np.float32)[:, :WIDTH] / 100
    holed, moved = depth.copy(), depth.copy()
    holed[:, :32], moved[:, 8:40] = np.nan, np.nan
    assert last([(holed, 0.01), (holed.copy(), 0.01)]) == 0
    changed = last([(holed, 0.01), (moved, 0.01)])
    assert changed is not None and 0.1 < changed < 0.2


def test_large_images_are_compared_in_part() -> None:
    large: List[Array] = [np.tile(seen(shift), (8, 8)) for shift in (0, 0, 3)]
    assert large[0].size > 2 * MAX_PIXELS
    successive = SuccessiveImages()
    assert [successive.changed(image, 1.0) for image in large[:2]] == [None, 0.0]
    moved = successive.changed(large[2], 1.0)
    assert moved is not None and moved > 0.7
