# SPDX-License-Identifier: BSD-3-Clause
import cv2
import numpy as np
import pytest

from smokebot_udp.codecs.view import COLOURS, FRESH, FROZEN, OLD, View, seconds, state_of


@pytest.mark.parametrize('age, completeness, state', [
    (0.1, 1.0, FRESH), (-5.0, 1.0, FRESH), (0.1, 0.2, OLD), (0.5, 1.0, OLD), (2.0, 1.0, FROZEN), (1e9, 1.0, FROZEN),
    (float('nan'), 1.0, FROZEN)])
def test_states(age, completeness, state):
    assert state_of(age, completeness, 0.5, 2.0) == state


@pytest.mark.parametrize('age, words', [(0.08, '0.08 s'), (63.2, '63 s'), (3600, '60 min')])
def test_ages_in_few_letters(age, words):
    assert seconds(age) == words


def inside(picture, height, width):
    """The picture without the frame."""
    edge = max(1, width // 160)
    return picture[edge:height - edge, edge:width - edge]


@pytest.mark.parametrize('order', ['<u2', '>u2'])
def test_a_fixed_range_in_units_takes_the_whole_palette(order):
    pixels = np.full((60, 80), 6829 + 50 * 25, order)       # 50 degrees in the middle of 0 to 100
    picture = View('hot', 0.0, 100.0, 25.0, -273.15, 'C').render(pixels, 'mono16', 0.1, 1.0, FRESH)
    expected = cv2.applyColorMap(np.array([[127]], np.uint8), cv2.COLORMAP_HOT)[0, 0].astype(int)
    assert np.abs(inside(picture, 60, 80).astype(int) - expected).max() <= 3


def test_a_fire_does_not_take_the_palette():
    pixels = np.tile(np.arange(7000, 7100, dtype=np.uint16), (100, 1))
    pixels[:10, :10] = 20000
    picture = View('bone').render(pixels, 'mono16', 0.1, 1.0, FRESH)
    grey = inside(picture, 100, 100).mean(axis=2)
    assert grey[50, 5] < 30 and grey[50, 90] > 220


def test_the_automatic_range_follows_slowly():
    view = View('bone')
    dark, bright = (np.tile(np.arange(k, k + 100, dtype=np.uint16), (100, 1)) for k in (1000, 5000))
    view.render(dark, 'mono16', 0.1, 1.0, FRESH)
    before = view._range
    view.render(bright, 'mono16', 0.1, 1.0, FRESH)
    assert before[0] < view._range[0] < before[0] + 0.25 * 4000


@pytest.mark.parametrize('encoding, pixel, bgr', [
    ('bgr8', (1, 2, 3), (1, 2, 3)), ('rgb8', (1, 2, 3), (3, 2, 1)), ('bgra8', (1, 2, 3, 9), (1, 2, 3)),
    ('rgba8', (1, 2, 3, 9), (3, 2, 1)), ('mono8', 7, (7, 7, 7))])
def test_what_has_8_bits_stays_as_it_is(encoding, pixel, bgr):
    pixels = np.empty((40, 50) + np.shape(pixel), np.uint8)
    pixels[:] = pixel
    before = pixels.copy()
    picture = View().render(pixels, encoding, 0.1, 1.0, FRESH)
    assert (inside(picture, 40, 50) == bgr).all() and picture.shape[1] == 50 and picture.shape[0] > 40
    assert (pixels == before).all()


@pytest.mark.parametrize('state', [FRESH, OLD, FROZEN])
def test_frame_and_strip_tell_the_state(state):
    picture = View().render(np.full((480, 640, 3), 200, np.uint8), 'bgr8', 0.1, 1.0, state)
    assert tuple(picture[0, 0]) == tuple(picture[470, 639]) == tuple(picture[-1, 320]) == COLOURS[state]


def test_what_is_frozen_is_grey_and_dark():
    colours = np.zeros((480, 640, 3), np.uint8)
    colours[..., 2] = 255
    picture = View().render(colours, 'bgr8', 3.0, 1.0, FROZEN)
    corner = picture[20:60, 20:60].astype(int)
    assert corner.max() < 110 and (corner[..., 0] == corner[..., 2]).all()
    assert (picture[200:280] == COLOURS[FROZEN]).all(axis=2).any()     # the words


@pytest.mark.parametrize('pixels, encoding', [
    (np.full((1, 1), 5, np.uint16), 'mono16'), (np.zeros((3, 2, 3), np.uint8), 'bgr8'),
    (np.full((30, 40), np.nan, np.float32), '32FC1'), (np.full((30, 40), np.inf, np.float32), '32FC1'),
    (np.full((30, 40), 3.5, np.float32), '32FC1'), (np.zeros((1080, 1920), np.uint16), 'mono16')])
def test_odd_pictures(pixels, encoding):
    for state in (FRESH, FROZEN):
        picture = View().render(pixels, encoding, 1e6, 0.0, state)
        assert picture.dtype == np.uint8 and picture.shape[1:] == (pixels.shape[1], 3)
