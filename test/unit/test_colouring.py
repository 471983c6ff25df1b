# SPDX-License-Identifier: BSD-3-Clause
import math
import struct
from typing import Any, List

import cv2
import numpy as np
import pytest

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.display.colouring import (
    NO_READING,
    PALETTES,
    SETTLING,
    SHADES,
    AutomaticRange,
    Colouring,
    numbers,
)
from smokebot_udp.codecs.wire.pixels import ENCODINGS, as_pixels, pixel_type

KELVIN = {'counts_per_unit': 25.0, 'zero': -273.15, 'unit': 'degC'}


def shades(pixels: Any, encoding: str = 'mono16', time: float = 0.0, **settings: Any) -> List[List[int]]:
    """The grey shade of each pixel, -1: no reading."""
    bgr = Colouring('gray', **settings)(np.asarray(pixels), encoding, time).pixels.astype(int)
    return np.where((bgr == NO_READING).all(axis=2), -1, bgr[..., 0]).tolist()


def counts(*rows: Any) -> Array:
    return np.array(rows, np.uint16)


def test_a_fixed_range_in_counts() -> None:
    assert shades(counts([900, 1000, 1500, 2000, 2100]), low=1000.0, high=2000.0) == [[0, 0, 128, 255, 255]]


def test_a_fixed_range_in_degrees() -> None:
    kelvins = counts([7328, 7329, 8579, 9829, 65535])      # (20, 70, 120 degC + 273.15 K) * 25 / K
    image = Colouring('gray', 20.0, 120.0, **KELVIN)(kelvins, 'mono16', 0.0)
    assert image.pixels[0, :, 0].tolist() == [0, 0, 128, 255, 255]
    assert image.numbers == ('20', '45', '70', '95', '120') and image.unit == 'degC'


def test_another_cameras_counts() -> None:
    image = Colouring('gray', 0.0, 10.0, counts_per_unit=100.0, zero=-100.0)(
        counts([10000, 10500, 11000]), '16UC1', 0.0)
    assert image.pixels[0, :, 0].tolist() == [0, 128, 255]


def test_floats_in_a_fixed_range() -> None:
    nan, inf = math.nan, math.inf
    values = np.float32([[-1, 0, 0.5, 1, 2, 3e38, -3e38, nan, inf, -inf]])
    assert shades(values, '32FC1', high=1.0) == [[0, 0, 128, 255, 255, 255, 0, -1, -1, -1]]


def test_no_reading() -> None:
    assert shades(counts([0, 1000, 2000]), low=1000.0, high=2000.0) == [[-1, 0, 255]]
    assert shades(counts([0, 0]), **KELVIN) == [[-1, -1]]
    assert shades(np.float32([[math.nan, math.inf]]), '32FC1') == [[-1, -1]]


@pytest.mark.parametrize('palette', PALETTES)
def test_palettes(palette) -> None:
    image = Colouring(palette, 1000.0, 1000.0 + SHADES - 1)(
        np.arange(1000, 1000 + SHADES, dtype=np.uint16)[np.newaxis], 'mono16', 0.0)
    assert image.palette.shape == (SHADES, 3)
    assert np.array_equal(image.pixels[0], image.palette)
    assert not (image.palette == NO_READING).all(axis=1).any() and NO_READING[0] != NO_READING[1]
    ends = cv2.applyColorMap(np.uint8([[0, 255]]), getattr(cv2, 'COLORMAP_' + palette.upper()))[0] \
        if palette != 'gray' else [[0, 0, 0], [255, 255, 255]]
    assert image.palette[[0, -1]].tolist() == np.asarray(ends).tolist()


@pytest.mark.parametrize('order', '<>')
def test_byte_orders(order) -> None:
    data = struct.pack(order + '3H', 1000, 1500, 2000)
    pixels = as_pixels(data, 1, 3, 6, 'mono16', order == '>')
    assert shades(pixels, low=1000.0, high=2000.0) == [[0, 128, 255]]
    data = struct.pack(order + '2f', 0.0, 1.0)
    assert shades(as_pixels(data, 1, 2, 8, '32FC1', order == '>'), '32FC1', high=1.0) == [[0, 255]]


@pytest.mark.parametrize('encoding, pixel, bgr', [
    ('mono8', 7, [7, 7, 7]), ('8UC1', 7, [7, 7, 7]), ('bgr8', [1, 2, 3], [1, 2, 3]), ('8UC3', [1, 2, 3], [1, 2, 3]),
    ('rgb8', [1, 2, 3], [3, 2, 1]), ('bgra8', [1, 2, 3, 4], [1, 2, 3]), ('8UC4', [1, 2, 3, 4], [1, 2, 3]),
    ('rgba8', [1, 2, 3, 4], [3, 2, 1])])
def test_plain_images_are_as_they_are(encoding, pixel, bgr) -> None:
    image = Colouring()(np.uint8([[pixel]]), encoding, 0.0)
    assert image.pixels.tolist() == [[bgr]] and image.palette is None and image.numbers == ()


def test_mosaics_are_shown_in_colours() -> None:
    mosaic = np.tile(np.uint8([[200, 100], [100, 10]]), (8, 8))
    image = Colouring()(mosaic, 'bayer_rggb8', 0.0)
    assert (image.pixels[2:-2, 2:-2] == [10, 100, 200]).all() and image.palette is None


@pytest.mark.parametrize('encoding', sorted(ENCODINGS))
@pytest.mark.parametrize('height, width', [(1, 1), (1, 4), (4, 1), (1, 700), (700, 1), (5, 3)])
@pytest.mark.parametrize('bigendian', [False, True])
def test_every_shape_of_every_encoding(encoding, height, width, bigendian) -> None:
    dtype, channels = pixel_type(encoding, bigendian)
    step = width * channels * dtype.itemsize + 3
    data = np.random.RandomState(height).bytes(height * step)
    pixels = as_pixels(data, height, width, step, encoding, bigendian)
    image = Colouring(**KELVIN)(pixels, encoding, 0.0)
    assert image.pixels.shape == (height, width, 3) and image.pixels.dtype == np.uint8
    assert image.pixels.dtype == np.uint8


@pytest.mark.parametrize('settings, message', [
    ({'palette': 'pink panther'}, "palette is 'pink panther', must be one of inferno"),
    ({'counts_per_unit': 0.0}, 'counts_per_unit is 0.0'), ({'counts_per_unit': math.nan}, 'counts_per_unit is nan')])
def test_bad_settings(settings, message) -> None:
    with pytest.raises(ValueError, match=message):
        Colouring(**settings)


def test_bad_encoding() -> None:
    with pytest.raises(ValueError, match="encoding is 'yuv422'"):
        Colouring()(counts([1]), 'yuv422', 0.0)


# --- the automatic range

def room_with_fire(share: float, hot: float = 500.0) -> Array:
    """20 to 30 degC, with some ratio of hot pixels, as counts."""
    celsius = np.linspace(20.0, 30.0, 10000)
    celsius[:int(share * 10000)] = hot
    return np.rint((np.random.RandomState(1).permutation(celsius) + 273.15) * 25).astype(np.uint16).reshape(100, 100)


@pytest.mark.parametrize('share', [0.0001, 0.01, 0.1, 0.3, 0.45])
def test_a_fire_does_not_wash_out_the_room(share) -> None:
    image = room_with_fire(share)
    grey = np.array(shades(image, **KELVIN))
    room = grey[image < 8000]
    assert np.percentile(room, 95) - np.percentile(room, 5) > 130
    assert (grey[image > 8000] == 255).all() and room.max() < 230


def test_the_scale_shows_the_fire() -> None:
    image = Colouring(**KELVIN)(room_with_fire(0.1), 'mono16', 0.0)
    assert image.numbers[0] in ('20', '21') and image.numbers[-1] == '500'
    assert 28 <= float(image.numbers[3]) <= 35     # KNEE is one of MARKS


def test_a_cold_window_takes_no_contrast_from_the_warmer_half() -> None:
    image = room_with_fire(0.03, hot=-30.0)
    grey = np.array(shades(image, **KELVIN))
    assert np.percentile(grey, 95) - np.percentile(grey, 55) > 80


def test_two_fires_are_told_apart() -> None:
    image = room_with_fire(0.1)
    image[0, :50] = (300 + 273.15) * 25
    grey = np.array(shades(image, **KELVIN))
    assert 200 < grey[0, 0] < 235 and (grey[0, :50] == grey[0, 0]).all()


def test_without_fires_the_scale_is_even() -> None:
    values, shares = AutomaticRange().follow(np.arange(1000, 3000, dtype=np.uint16).reshape(40, 50), 0.0)
    assert np.allclose(shares, (values - values[0]) / (values[-1] - values[0]), atol=0.03)
    assert values == pytest.approx([1020, 2000, 2960, 2999], abs=2)


def test_missing_pixels_do_not_stretch_the_range() -> None:
    image = room_with_fire(0.0)
    whole = AutomaticRange().follow(image, 0.0)[0]
    image[::3] = 0
    assert AutomaticRange().follow(image, 0.0)[0] == pytest.approx(whole, abs=5)
    floats = image.astype(np.float32)
    floats[::3] = np.nan
    floats[1, 1:4] = np.inf, -np.inf, np.nan
    assert AutomaticRange().follow(floats, 0.0)[0] == pytest.approx(whole, abs=5)


def test_noise_does_not_fill_the_palette() -> None:
    wall = np.rint(7430 + np.random.RandomState(1).standard_normal((100, 100)) * 1.25).astype(np.uint16)   # 0.05 K
    assert np.std(shades(wall, **KELVIN)) < 12
    spot = wall.copy()
    spot[:3, :3] = 20000
    spot[50:53] = 6000    # 3 % are cold
    assert np.std(np.array(shades(spot, **KELVIN))[10:40]) < 12


@pytest.mark.parametrize('value', [1, 7000, 65535])
def test_a_constant_image_has_one_shade(value) -> None:
    assert len(np.unique(shades(np.full((3, 3), value, np.uint16)))) == 1


@pytest.mark.parametrize('value', [0.0, -273.15, 1e-30, 3e38, -3e38])
def test_a_constant_image_of_floats(value) -> None:
    grey = np.array(shades(np.full((3, 3), value, np.float32), '32FC1'))
    assert len(np.unique(grey)) == 1 and grey[0, 0] >= 0


def test_extreme_floats() -> None:
    values = np.float32([[-3e38, 3e38, 0.0, 1.0] * 4])
    grey = np.array(shades(values, '32FC1'))[0]
    assert grey[0] == 0 and grey[1] == 255 and 0 < grey[2] < 255


def test_the_range_follows_smoothly() -> None:
    follows = AutomaticRange()
    cold, warm = np.full((2, 2), 1000, np.uint16), np.full((2, 2), 2000, np.uint16)
    assert follows.follow(cold, 0.0)[0][1] == 1000
    assert follows.follow(warm, SETTLING)[0][1] == pytest.approx(1000 + 1000 * (1 - 1 / math.e))
    assert follows.follow(warm, SETTLING)[0][1] == pytest.approx(1000 + 1000 * (1 - 1 / math.e))
    assert follows.follow(np.zeros((2, 2), np.uint16), 1.0)[0][1] == pytest.approx(1632, abs=1)
    assert follows.follow(warm, 60.0)[0][1] == pytest.approx(2000)
    assert follows.follow(cold, 59.0)[0][1] == 1000       # the clock was set back


def test_the_automatic_map_rises() -> None:
    random = np.random.RandomState(7)
    for _ in range(200):
        image = (random.gamma(random.uniform(0.05, 3), 10 ** random.uniform(0, 4), (20, 20)) + random.randint(
            1, 9000)).clip(0, 65535).astype(np.uint16)
        values, shares = AutomaticRange().follow(image, 0.0)
        assert (np.diff(values) >= 0).all() and (np.diff(shares) >= 0).all()
        assert shares[0] == 0 and shares[-1] == 1
        grey = np.array(shades(image))
        order = np.argsort(image, axis=None)
        assert (np.diff(grey.ravel()[order]) >= 0).all()


@pytest.mark.parametrize('values, texts', [
    ([20, 45, 70, 95, 120], ('20', '45', '70', '95', '120')),
    ([20.1, 20.5, 21.0, 22.5, 600.2], ('20.1', '20.5', '21.0', '22', '600')),
    ([0, .25, .5, .75, 1], ('0.0', '0.2', '0.5', '0.8', '1.0')), ([5, 5], ('5', '5')),
    ([-3e38, 3e38], ('-3e+38', '3e+38'))])
def test_numbers(values, texts) -> None:
    assert numbers(np.float64(values)) == texts


@pytest.mark.parametrize('values, texts', [
    ([1e6, 1.0001e6, 1.0002e6], ('1000000', '1000100', '1000200')),
    ([1e5, 1e5 + 25, 1e5 + 50], ('100000', '100025', '100050')),
    ([0, 5e5, 1e6], ('0', '500000', '1000000')), ([-1.5e6, 0, 1.5e6], ('-1.5e+06', '0', '1500000')),
    ([2e12, 2.0001e12, 2.0002e12], ('2e+12', '2.0001e+12', '2.0002e+12')),
    ([3e38, 3e38], ('3e+38', '3e+38')), ([20.0, 20.5], ('20.0', '20.5'))])
def test_large_numbers_differ_where_their_values_do(values: List[float], texts: Any) -> None:
    assert numbers(np.array(values, float)) == texts
