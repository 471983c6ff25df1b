# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any, List, Tuple

import cv2
import numpy as np
import pytest

from smokebot_udp.arrays import UInt8Array
from smokebot_udp.codecs.display.colouring import MARKS, SHADES, Coloured, Colouring
from smokebot_udp.codecs.display.view import (
    BLACK,
    COLOURS,
    FRESH,
    FROZEN,
    OLD,
    Limits,
    duration,
    framed,
    layout,
    titled,
)
from smokebot_udp.image_error import EIGHT_BITS, ImageError

LIMITS = Limits(old_after=0.5, frozen_after=2.0, least_complete=0.5)
KELVIN = {'counts_per_unit': 25.0, 'zero': -273.15, 'unit': 'degC'}
GREY = Coloured(np.full((480, 640, 3), 100, np.uint8))


def middle_of_border(image: UInt8Array) -> List[Tuple[int, ...]]:
    """Colours of the border: left, top, right; and of the strip's corner below."""
    height, width = image.shape[:2]
    return [tuple(image[at].tolist()) for at in ((height // 2, 1), (1, width // 2), (height // 2, width - 2),
                                                  (height - 2, 2))]


@pytest.mark.parametrize('age, completeness, silence, state', [
    (0.0, 1.0, 0.0, FRESH), (0.12, 0.87, 0.0, FRESH), (0.49, 0.5, 0.0, FRESH), (-0.05, 1.0, 0.0, FRESH),
    (0.5, 1.0, 0.0, OLD), (1.99, 1.0, 0.0, OLD), (0.1, 0.49, 0.0, OLD), (0.1, 0.0, 0.0, OLD),
    (-3.0, 1.0, 0.0, OLD), (-math.inf, 1.0, 0.0, OLD),
    (2.0, 1.0, 0.0, FROZEN), (1e9, 1.0, 0.0, FROZEN), (math.inf, 0.0, math.inf, FROZEN), (math.nan, 1.0, 0.0, FROZEN),
    (-100.0, 1.0, 0.4, OLD), (-100.0, 1.0, 0.6, OLD), (-100.0, 1.0, 2.0, FROZEN), (0.0, 1.0, 3.0, FROZEN),
    (math.nan, 1.0, 0.6, OLD), (math.nan, 1.0, 9.0, FROZEN), (9.0, 1.0, 0.6, FROZEN)])
def test_colours_of_the_states(age, completeness, silence, state) -> None:
    assert middle_of_border(framed(GREY, age, completeness, LIMITS, silence)) == [COLOURS[state]] * 4


@pytest.mark.parametrize('completeness', [-0.01, 1.01, math.nan])
def test_bad_completeness(completeness) -> None:
    with pytest.raises(ValueError, match='completeness is'):
        framed(GREY, 0.1, completeness, LIMITS)


@pytest.mark.parametrize('age', [0.1, 0.9])
def test_no_pixel_is_covered(age) -> None:
    pixels = np.random.RandomState(1).randint(0, 256, (480, 640, 3)).astype(np.uint8)
    image = framed(Coloured(pixels, np.zeros((254, 3), np.uint8), ('1',) * 5, 'degC'), age, 0.9, LIMITS)
    place = layout(480, 640)
    assert place == (1, (0, 0, 0, 0), 6, 54)
    assert image.shape == (480 + 6 + 54, 640 + 12, 3)
    assert np.array_equal(image[6:486, 6:646], pixels)


def test_small_images_are_enlarged() -> None:
    pixels = np.random.RandomState(1).randint(0, 256, (120, 160, 3)).astype(np.uint8)
    image = framed(Coloured(pixels), 0.1, 1.0, LIMITS)
    assert layout(120, 160) == (3, (0, 0, 0, 0), 4, 41)
    assert np.array_equal(image[4:364, 4:484], pixels.repeat(3, axis=0).repeat(3, axis=1))


@pytest.mark.parametrize('height, width, shape', [
    (1, 1, (480 + 4 + 41, 488)), (1200, 1, (1200 + 4 + 41, 488)), (1, 1200, (120 + 12 + 102, 1224)),
    (240, 320, (480 + 6 + 54, 652)), (1200, 1920, (1200 + 19 + 163, 1958))])
@pytest.mark.parametrize('age', [0.1, 9.0])
def test_shapes(height, width, shape, age) -> None:
    coloured = Colouring()(np.full((height, width), 7000, np.uint16), 'mono16', 0.0)
    assert framed(coloured, age, 1.0, LIMITS, silence=age).shape == shape + (3,)


def test_narrow_images_are_padded_with_black() -> None:
    image = framed(Coloured(np.full((600, 2, 3), 200, np.uint8)), 0.1, 1.0, LIMITS)[4:604, 4:-4]
    assert (image[:, 239:241] == 200).all() and not image[:, :239].any() and not image[:, 241:].any()


def test_the_scale_shows_the_palette_under_the_image() -> None:
    coloured = Colouring('jet', 1000.0, 2000.0)(np.full((480, 640), 1500, np.uint16), 'mono16', 0.0)
    image = framed(coloured, 0.1, 1.0, LIMITS)
    bar = image[486 + 8]
    left, right = int(646 * 0.46), int(646 * 0.89)
    for share in (0.1, 0.4, 0.6, 0.9):       # between the marks
        at, expected = int(left + share * (right - left)), coloured.palette[int(share * SHADES)]
        assert np.abs(bar[at].astype(int) - expected).max() <= 8
    for share in MARKS:
        assert (bar[int(left + share * (right - 1 - left))] == 255).all()
    assert not np.array_equal(image[486:, 300:646], framed(GREY, 0.1, 1.0, LIMITS)[486:, 300:646])


def test_a_frozen_images_scale_has_no_colours_either() -> None:
    coloured = Colouring('jet', 1000.0, 2000.0)(np.full((480, 640), 1500, np.uint16), 'mono16', 0.0)
    bar = framed(coloured, 3.0, 1.0, LIMITS)[486 + 8, 300:570].astype(int)
    assert (bar == bar[:, :1]).all() and len(np.unique(bar)) > 20


def strip_of(*arguments: float, **options: float) -> UInt8Array:
    return framed(GREY, *arguments, LIMITS, **options)[486:]


def test_the_strip_shows_age_and_completeness_apart() -> None:
    first, older, poorer = strip_of(0.12, 0.87), strip_of(0.13, 0.87), strip_of(0.12, 0.86)
    assert np.array_equal(first, strip_of(0.12, 0.87))
    assert (first != older).any(axis=(0, 2)).nonzero()[0].max() < 0.22 * 652
    assert (first != poorer).any(axis=(0, 2)).nonzero()[0].min() >= 0.22 * 652


def test_an_age_that_is_only_the_least_possible_is_marked(monkeypatch) -> None:
    assert texts_of(monkeypatch, 0.12, 1.0) == ['0.12 s', '100 %']
    assert texts_of(monkeypatch, 0.12, 1.0, at_least=True) == ['> 0.12 s', '100 %']


def test_what_is_wrong_is_marked() -> None:
    def black(strip: UInt8Array) -> List[bool]:
        return [bool((strip[20:34, columns] == BLACK).all(axis=2).sum() > 900)       # a box, not letters
                for columns in (slice(7, 140), slice(144, 270))]
    assert black(strip_of(0.1, 1.0)) == [False, False]
    assert black(strip_of(0.9, 1.0)) == [True, False]
    assert black(strip_of(0.1, 0.2)) == [False, True]
    assert black(strip_of(-3.0, 0.2)) == [True, True]


def test_a_notice_takes_the_place_of_the_scale_and_covers_nothing_else(monkeypatch) -> None:
    coloured = Coloured(GREY.pixels, np.zeros((254, 3), np.uint8), ('1',) * 5, 'degC')
    plain, noticed = (framed(coloured, 0.1, 1.0, LIMITS, notice=notice) for notice in ('', 'EMERGENCY STOP'))
    differ = (plain != noticed).any(axis=2)
    rows, columns = differ.nonzero()
    assert rows.min() >= 486 and columns.min() >= int(0.42 * 646)
    assert (noticed[490, 300:640] == COLOURS[FROZEN]).all(axis=1).mean() > 0.9
    assert texts_of(monkeypatch, 0.1, 1.0, coloured=coloured, notice='EMERGENCY STOP') == [
        '0.10 s', '100 %', 'EMERGENCY STOP']
    assert texts_of(monkeypatch, 0.1, 1.0, notice='LOCKED: cmd_vel: no image')[2:] == ['LOCKED', 'cmd_vel: no image']


def test_a_lost_pixel_is_never_all_of_them(monkeypatch) -> None:
    written = texts_of(monkeypatch, 0.1, 0.9999)
    assert written == ['0.10 s', '99 %']


def texts_of(monkeypatch: Any, *arguments: float, **options: Any) -> List[str]:
    written: List[str] = []
    monkeypatch.setattr(cv2, 'putText', lambda image, text, *rest: written.append(text))
    framed(options.pop('coloured', GREY), *arguments, LIMITS, **options)
    return list(dict.fromkeys(written))


@pytest.mark.parametrize('age, completeness, silence, texts', [
    (0.12, 0.87, 0.0, ['0.12 s', '87 %']), (-0.05, 0.29, 0.0, ['0.00 s', '29 %']),
    (-3.0, 1.0, 0.0, ['-3.0 s', '100 %']),
    (3.2, 1.0, 3.1, ['3.2 s', '100 %', 'NO DATA 3.2 s']), (12.0, 1.0, 0.0, ['12.0 s', '100 %', 'LATE 12.0 s']),
    (-50.0, 1.0, 3.1, ['3.1 s', '100 %', 'NO DATA 3.1 s']), (math.nan, 1.0, 0.0, ['? s', '100 %', 'LATE ? s']),
    (math.inf, 0.0, math.inf, ['? s', '0 %', 'NO DATA YET'])])
def test_texts(monkeypatch, age, completeness, silence, texts) -> None:
    assert texts_of(monkeypatch, age, completeness, silence=silence) == texts


@pytest.mark.parametrize('rms, text, state', [
    (0.0, 'exact', FRESH), (2.55, '40 dB', FRESH), (25.4, '20 dB', FRESH), (25.6, '20 dB', OLD), (255.0, '0 dB', OLD)])
def test_an_error_replaces_the_completeness(monkeypatch, rms, text, state) -> None:
    """Yellow below least_psnr; the completeness does not count then."""
    error = ImageError(rms, EIGHT_BITS)
    assert middle_of_border(framed(GREY, 0.1, 0.0, LIMITS, error=error)) == [COLOURS[state]] * 4
    assert texts_of(monkeypatch, 0.1, 0.0, error=error) == ['0.10 s', text]


@pytest.mark.parametrize('rms, text, state', [(10.0, '+-0.4 degC', FRESH), (251.0, '+-10 degC', OLD)])
def test_an_error_is_judged_by_the_range_of_the_colours(monkeypatch, rms, text, state) -> None:
    coloured = Colouring('jet', 20.0, 120.0, **KELVIN)(np.uint16([[8000]]), 'mono16', 0.0)
    assert coloured.span == pytest.approx(2500.0)
    error = ImageError(rms, None, 25.0, 'degC')
    assert middle_of_border(framed(coloured, 0.1, 1.0, LIMITS, error=error))[:3] == [COLOURS[state]] * 3
    assert texts_of(monkeypatch, 0.1, 1.0, coloured=coloured, error=error)[1] == text


def test_numbers_and_unit_are_written(monkeypatch) -> None:
    coloured = Colouring('jet', 20.0, 120.0, **KELVIN)(np.uint16([[8000]]), 'mono16', 0.0)
    assert texts_of(monkeypatch, 0.1, 1.0, coloured=coloured)[2:] == ['20', '45', '70', '95', '120', 'degC']


@pytest.mark.parametrize('seconds, text', [
    (0, '0.00 s'), (0.123, '0.12 s'), (0.999, '1.00 s'), (1, '1.0 s'), (3.21, '3.2 s'), (99.9, '99.9 s'),
    (130, '2 min'), (5.2 * 3600, '5 h'), (1e9, '> 99 h'), (-4.0, '-4.0 s'), (math.inf, '? s'), (math.nan, '? s')])
def test_durations(seconds, text) -> None:
    assert duration(seconds) == text


def test_a_frozen_image_is_grey_and_dim() -> None:
    pixels = np.zeros((480, 640, 3), np.uint8)
    pixels[:] = 0, 0, 255
    image = framed(Coloured(pixels), 3.2, 1.0, LIMITS, silence=3.2)
    b, g, r = image[50, 50].tolist()
    assert b == g == r and r < 140
    banner = image[200:290, 6:646].astype(int)
    assert ((banner[..., 2] - banner[..., 1]) > 100).sum() > 3000      # large, and across it
    assert np.abs(banner - banner[..., :1]).max(axis=(0, 2)).nonzero()[0].min() < 80
    assert np.abs(banner - banner[..., :1]).max(axis=(0, 2)).nonzero()[0].max() > 560


@pytest.mark.parametrize('thickness', [True, False], ids=['as drawn here', 'as OpenCV 5, which ignores the thickness'])
@pytest.mark.parametrize('height, width', [(120, 160), (480, 640), (1200, 1920)])
def test_the_banner_has_a_dark_outline_on_a_bright_image(monkeypatch, thickness: bool, height: int, width: int) -> None:
    put_text = cv2.putText
    if not thickness:
        monkeypatch.setattr(cv2, 'putText', lambda *arguments: put_text(*arguments[:6], 1, cv2.LINE_AA))
    view = framed(Coloured(np.full((height, width, 3), 255, np.uint8)), 3.2, 1.0, LIMITS, silence=3.2)
    place = layout(height, width)
    image = view[place.border:-place.strip, place.border:-place.border]
    red, dark = (image[..., 2].astype(int) - image[..., 1] > 100), (image.max(axis=2) < 20)
    inner = np.s_[place.padding[0]:len(image) - place.padding[1]]
    assert dark[inner].sum() > 0.5 * red[inner].sum() > 0
    # whatever is above, below or beside the text is dark
    rows, columns = np.nonzero(cv2.dilate(red.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
    assert (image[rows, columns].max(axis=1) < 130)[~red[rows, columns]].mean() > 0.95


@pytest.mark.parametrize('height, width', [(120, 160), (480, 640), (1200, 1920)])
def test_text_is_as_large_as_the_view(height, width, monkeypatch) -> None:
    heights = []
    monkeypatch.setattr(cv2, 'putText', lambda image, text, at, font, scale, *rest: heights.append(21 * scale))
    coloured = Colouring(**KELVIN)(np.full((height, width), 7000, np.uint16), 'mono16', 0.0)
    view_width = framed(coloured, 0.12, 0.87, LIMITS).shape[1]
    assert min(heights[:2]) > view_width / 40 and min(heights) > view_width / 70


def test_texts_are_as_large_where_the_size_of_a_text_is_that_of_its_line(monkeypatch) -> None:
    """As in OpenCV 5: 27 pixels at scale 1, of which capitals have 22."""
    text_size = cv2.getTextSize
    shown = framed(GREY, 3.2, 1.0, LIMITS, silence=3.2)
    monkeypatch.setattr(cv2, 'getTextSize', lambda *arguments: ((text_size(*arguments)[0][0], 27), 1))
    assert np.array_equal(framed(GREY, 3.2, 1.0, LIMITS, silence=3.2), shown)


def test_a_titled_image_looks_like_a_view_but_is_grey() -> None:
    thermal = Colouring('inferno', 0.0, 100.0)(np.tile(np.arange(500, dtype=np.uint16), (400, 1)), 'mono16', 0.0)
    image, live = titled(thermal, 'thermal, as sent'), framed(thermal, 0.1, 1.0, Limits())
    place = layout(400, 500)
    assert image.shape == live.shape and len(set(image[0, 0].tolist())) == 1
    assert tuple(live[0, 0].tolist()) == COLOURS[FRESH]
    inside = np.s_[place.border:-place.strip, place.border:-place.border]
    assert (image[inside] == live[inside]).all()
    scale = np.s_[-place.strip:-place.border, 300:-place.border]
    assert (image[scale] == live[scale]).all()
    assert (image[-place.strip:, :200].min(axis=2) > 150).any()     # the title
