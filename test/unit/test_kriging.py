# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import Array, BoolArray
from smokebot_udp.codecs.concealment.fill import nearest
from smokebot_udp.codecs.concealment.kriging import CLAMPING, SMOOTH, kriging_clamped, weigh
from smokebot_udp.codecs.wire.interleave import Interleave
from smokebot_udp.codecs.wire.partial_image import FillMethod

TYPES = ['u1', '<u2', '>u2', '<f4', '>f4']


def received_pixels(cut: Interleave, have: BoolArray) -> BoolArray:
    """(height, width) bool"""
    return cut.merge(np.repeat(have, cut.shape[0] * cut.shape[1]).reshape((-1,) + cut.shape))


def a_set(cut: Interleave, share: float, seed: int) -> BoolArray:
    """(n,) bool: some subimages, at least one, not all."""
    assume(len(cut) > 1)
    random = np.random.RandomState(seed)
    have = random.random_sample(len(cut)) < share
    have[random.permutation(len(cut))[:2]] = True, False
    return have


def filled(image: Array, have: BoolArray, cut: Interleave, method: FillMethod = kriging_clamped) -> Array:
    return cut.merge(method(cut.split(image), have, cut))


def g(h: Array, smooth: float = SMOOTH) -> Array:
    """The model of the variogram."""
    return np.sqrt(h ** 2 + smooth ** 2) - smooth


cuts = st.builds(Interleave, st.integers(1, 40), st.integers(1, 40), st.integers(0, 4))
any_case = given(cuts, st.floats(0, 1), st.integers(0, 999))
many = settings(max_examples=150, deadline=None)


@pytest.mark.parametrize('offsets, weights', [
    ([(3, 4)], [1]),
    ([(0, -1), (0, 1)], [1 / 2, 1 / 2]),
    ([(0, -1), (0, 1), (-1, 0), (1, 0)], [1 / 4] * 4),
    # one behind the other, at 1 and 2, g(1) apart: 2 g(1) w = g(1) + g(1) - g(2) for the farther one
    ([(0, 1), (0, 2)], [g(2) / (2 * g(1)), 1 - g(2) / (2 * g(1))]),
    # at 1 on one side and 2 on the other, 3 apart: 2 g(3) w = g(1) + g(3) - g(2) for the farther one
    ([(-1, 0), (2, 0)], [0.5 + (g(2) - g(1)) / (2 * g(3)), 0.5 - (g(2) - g(1)) / (2 * g(3))]),
])
def test_weights_by_hand(offsets, weights) -> None:
    assert weigh(np.array([offsets])).tolist() == [pytest.approx(weights, abs=1e-6)]


@given(st.lists(st.tuples(st.integers(-32, 32), st.integers(-32, 32)), min_size=1, max_size=12, unique=True),
       st.sampled_from([0.0, 0.5, 1.0, 3.0]))
@settings(deadline=None)
def test_weights_solve_the_equations_of_ordinary_kriging(offsets, smooth) -> None:
    """With the Lagrange multiplier that the textbooks have; ours are the differences of their rows."""
    points, k = np.array(offsets, float), len(offsets)
    equations = np.ones((k + 1, k + 1))
    equations[:k, :k] = g(np.linalg.norm(points[:, np.newaxis] - points, axis=2), smooth)
    equations[k, k] = 0
    right = np.append(g(np.linalg.norm(points, axis=1), smooth), 1)
    np.testing.assert_allclose(weigh(np.array([offsets]), smooth)[0], np.linalg.solve(equations, right)[:k], atol=1e-3)


def test_a_row_by_hand() -> None:
    """What lies left and right of the first missing pixel mirrors: the weights of both sides sum to 1/2."""
    cut = Interleave(1, 4, 1)
    image = np.array([[10, 99, 20, 99]], np.uint8)
    assert filled(image, np.array([True, False]), cut)[0, :3].tolist() == [10, 15, 20]


def test_a_slope_is_a_slope_where_neighbours_lie_all_around() -> None:
    cut = Interleave(32, 32, 2)
    image = np.add.outer(200 * np.arange(32), 30 * np.arange(32)).astype(np.uint16)
    for missing in range(len(cut)):
        result = filled(image, np.arange(len(cut)) != missing, cut)
        assert (result[4:-4, 4:-4] == image[4:-4, 4:-4]).all()


@pytest.mark.parametrize('shape', [(64, 96), (61, 83)])
def test_at_the_border_no_pixel_is_filled_from_afar(shape) -> None:
    """Half of 1024 subimages came: each pixel has neighbours within 4 pixels, on the image's side too."""
    cut = Interleave(*shape, 5)
    image = np.add.outer(100 * np.arange(shape[0]), 100 * np.arange(shape[1])).astype(np.uint16)
    have = np.random.RandomState(4).random_sample(len(cut)) < 0.5
    error = filled(image, have, cut) - image.astype(int)
    assert abs(error).max() < 500


def test_an_estimate_does_not_exceed_its_neighbours() -> None:
    """A ridge: 200 200 ? 200 200 in each row, 0 above and below."""
    image = np.zeros((16, 16), np.uint8)
    image[6:9] = 200
    cut = Interleave(16, 16, 2)
    have = np.arange(len(cut)) != 5
    came = received_pixels(cut, have)
    assert set(filled(image, have, cut)[~came]) <= set(range(201))


@any_case
@many
def test_a_constant_image_stays_constant(cut, share, seed) -> None:
    have = a_set(cut, share, seed)
    for kind, value in (('u1', 255), ('u1', 0), ('>u2', 65535), ('u2', 29315), ('f4', 0.1)):
        image = np.full((cut.height, cut.width), value, kind)
        result = filled(image, have, cut)
        assert result.dtype == image.dtype
        np.testing.assert_allclose(result, image, rtol=0 if kind != 'f4' else 1e-5)


@any_case
@many
def test_received_pixels_are_untouched_whatever_came(cut, share, seed) -> None:
    have = a_set(cut, share, seed)
    came = received_pixels(cut, have)
    for kind in TYPES:
        image = np.frombuffer(np.random.RandomState(seed).bytes(cut.height * cut.width * np.dtype(kind).itemsize),
                                kind).reshape(cut.height, cut.width)
        subimages = cut.split(image)
        subimages[~have] = 99      # of no matter
        result = cut.merge(kriging_clamped(subimages, have, cut))
        assert result.dtype == image.dtype
        assert result[came].tobytes() == image[came].tobytes()


@any_case
@many
def test_clamped_stays_within_its_nearest_neighbours(cut, share, seed) -> None:
    have = a_set(cut, share, seed)
    came = received_pixels(cut, have)
    image = np.random.RandomState(seed).choice(np.array([0, 7, 65535], np.uint16), (cut.height, cut.width))
    result = filled(image, have, cut)
    assert np.isin(result[came], image).all()
    rows, columns = np.nonzero(came)
    for row, column in np.argwhere(~came):
        distance = np.hypot(rows - row, columns - column)
        reach = np.sort(distance)[:CLAMPING][-1]
        border = min(row, column, cut.height - 1 - row, cut.width - 1 - column)
        if border < max(reach, 2 * cut.p):
            continue      # near the border subimages repeat
        near = distance <= reach
        low, high = (extreme(image[rows[near], columns[near]]) for extreme in (np.min, np.max))
        assert low <= result[row, column] <= high


@pytest.mark.parametrize('kind', ['u1', 'u2'])
def test_estimates_beyond_the_type_are_its_limits(kind) -> None:
    most = np.iinfo(kind).max
    image = (np.add.outer(np.arange(32) // 3, np.arange(32) // 3) % 2 * most).astype(kind)
    cut = Interleave(32, 32, 2)
    have = np.arange(len(cut)) % 3 > 0
    came = received_pixels(cut, have)
    result = filled(image, have, cut)[~came]
    exact = filled(image.astype('f8'), have, cut)[~came]
    assert exact.max() == most and exact.min() == 0
    assert result.tolist() == np.rint(exact).astype(kind).tolist()


@pytest.mark.parametrize('channels', [1, 2, 3, 4])
def test_channels_are_filled_each_for_itself_in_any_byte_order(channels) -> None:
    cut = Interleave(21, 34, 3)
    image = np.random.RandomState(0).randint(0, 65536, (21, 34, channels)).astype('<u2')
    have = np.random.RandomState(1).random_sample(len(cut)) < 0.4
    result = filled(image, have, cut)
    assert (filled(image.astype('>u2'), have, cut) == result).all()
    for channel in range(channels):
        assert (filled(image[..., channel], have, cut) == result[..., channel]).all()


def test_where_a_neighbour_is_no_number_the_nearest_counts() -> None:
    cut = Interleave(24, 24, 2)
    image = np.full((24, 24), 2.5, 'f4')
    image[8:16, 8:16] = np.nan
    image[:4, :4] = np.inf
    have = np.arange(len(cut)) % 2 > 0
    result = filled(image, have, cut)
    assert np.isnan(result[11:13, 11:13]).all() and np.isposinf(result[:2, :2]).all()
    numbers = result[np.isfinite(result)]
    np.testing.assert_allclose(numbers, 2.5, rtol=1e-6)
    assert len(numbers) > 450


@pytest.mark.parametrize('count', [1, 2, 5, 13, 30, 50, 63])
def test_images_are_better_than_with_the_nearest(count) -> None:
    waves = np.sin(np.arange(160) / 9)
    noise = 30 * np.random.RandomState(0).randn(120, 160)
    image = (30000 + 20000 * np.outer(waves[:120], waves) + noise).astype(np.uint16)
    cut = Interleave(120, 160, 3)
    have = np.random.RandomState(count).permutation(len(cut)) < count
    error, error_of_nearest = (np.std(filled(image, have, cut, method) - image.astype(float))
                               for method in (kriging_clamped, nearest))
    assert error < 0.8 * error_of_nearest
