# SPDX-License-Identifier: BSD-3-Clause
"""What is predicted of a band: its reference, shrunk where it does not stand out of noise; and the coding of that."""
from typing import Any

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.layered import noise_choice, prediction, range_coder, shrinking
from smokebot_udp.codecs.layered.layout import COLUMNS, ORIGIN, ROWS, layout_of

PLAN = layout_of(61, 83, 1, False)
SIZE = 1 << 12


def cells_of(number: int) -> Array:
    """(rows, columns): where the coefficients of a band are on the canvas."""
    band = PLAN.bands[number]
    rows: Array = band[ORIGIN] + np.arange(band[ROWS])[:, np.newaxis] * PLAN.stride + np.arange(band[COLUMNS])
    return rows


def canvas(seed: int, magnitude: int) -> Array:
    return np.random.RandomState(seed).randint(-magnitude, magnitude + 1, PLAN.cells).astype(np.int32)


def noises(value: int) -> Array:
    return np.full(len(PLAN.bands), value, np.int64)


@pytest.mark.parametrize('magnitude', [0, 3, 300, 1 << 20, (1 << 31) - 1])
@pytest.mark.parametrize('number', [shrinking.FAINTEST, 14, shrinking.STRONGEST])
def test_coefficients_are_shrunk_by_their_neighbourhood(magnitude: int, number: int) -> None:
    reference = canvas(1, magnitude)
    found = shrinking.shrunk(reference, PLAN, noises(number))
    noise = shrinking.CELLS * shrinking.FAINT * 2 ** ((number - shrinking.FAINTEST) / 2)
    for band in range(len(PLAN.bands)):
        own = reference[cells_of(band)].astype(float)
        wide = np.pad(np.minimum(abs(own), shrinking.LARGEST), 1, 'edge')
        rows, columns = own.shape
        around = sum(wide[y:y + rows, x:x + columns] for y in range(3) for x in range(3))
        gain = around ** 2 / (around ** 2 + noise ** 2)
        # a step of e / n is 1/16, and its middle counts
        assert (abs(found[cells_of(band)] - gain * own) <= 0.045 * abs(own) + 1).all()


def test_without_noise_it_is_the_reference_and_unpredicted_bands_are_zero() -> None:
    reference, how = canvas(1, 1 << 30), noises(shrinking.PLAIN)
    how[3] = shrinking.NONE
    found = shrinking.shrunk(reference, PLAN, how)
    for band in range(len(PLAN.bands)):
        expected = reference[cells_of(band)] if band != 3 else np.zeros_like(found[cells_of(band)])
        assert (found[cells_of(band)] == expected).all()


def test_blocks_without_a_flag_are_not_predicted() -> None:
    reference, how = canvas(1, 9000), prediction.nothing(PLAN)
    how.noises[:] = shrinking.PLAIN
    how.flags[:] = 1
    how.flags[PLAN.flag_firsts[-1] - 1] = 0     # the last block of the last band
    found, last = prediction.predicted(reference, PLAN, how), cells_of(len(PLAN.bands) - 1)
    expected = reference[last].copy()
    rows, columns = expected.shape
    expected[(rows - 1) // 8 * 8:, (columns - 1) // 8 * 8:] = 0
    assert (found[last] == expected).all()


def test_gains_grow_from_none_to_all() -> None:
    assert (np.diff(shrinking.GAINS) >= 0).all() and shrinking.GAINS[0] == 0
    assert shrinking.GAINS[-1] == 1 << shrinking.GAIN_BITS
    assert shrinking.GAINS[shrinking.FINENESS] in (132, 128 + 4, 128)    # half of it, where e is n
    assert (shrinking.RATES[shrinking.FAINTEST:] > 0).all()


@pytest.mark.parametrize('strength, least, most', [(0.0, 1, 8), (32.0, 7, 13), (512.0, 14, 20)])
def test_the_noise_that_is_chosen_is_that_of_the_reference(strength: float, least: int, most: int) -> None:
    """Few large coefficients in both, noise in the reference."""
    random = np.random.RandomState(2)
    image = np.where(random.rand(PLAN.cells) < 0.03, random.randint(-20000, 20000, PLAN.cells), 0).astype(np.int32)
    reference = (image + random.normal(0, strength, PLAN.cells)).astype(np.int32)
    sums = noise_choice.samples(image, reference, PLAN)
    finest = noise_choice.best_noises(sums, np.full(len(PLAN.bands), 1e-4))[-3:]
    assert ((finest >= least) & (finest <= most)).all(), finest


def test_what_the_reference_shows_of_something_else_does_not_count() -> None:
    image, other = canvas(1, 100), canvas(2, 100000)
    assert noise_choice.samples(image, other, PLAN)[:, :, 0].sum() == 0
    assert noise_choice.samples(image, canvas(2, 100), PLAN)[-1, :, 0].sum() > 500


def coded(how: prediction.Prediction) -> Any:
    """The bytes of a prediction, and how many."""
    data = np.zeros(SIZE, np.uint8)
    complete, state = prediction.code_prediction(True, how, PLAN, data, range_coder.begin(True, data, 0))
    assert complete
    return data[:range_coder.finish(data, state)]


def decoded(data: Array) -> Any:
    """Whether it is complete, and the prediction."""
    found = prediction.nothing(PLAN)
    complete, _ = prediction.code_prediction(False, found, PLAN, data, range_coder.begin(False, data, 0))
    return complete, found


@settings(max_examples=60)
@given(st.lists(st.integers(shrinking.NONE, shrinking.STRONGEST), min_size=len(PLAN.bands), max_size=len(PLAN.bands)),
       st.integers(0, 2 ** 32 - 1), st.sampled_from([0.0, 0.1, 0.9, 1.0]))
def test_noises_and_flags_are_coded_without_loss(numbers: Any, seed: int, share: float) -> None:
    how = prediction.nothing(PLAN)
    how.noises[:] = numbers
    for band in np.flatnonzero(how.noises):
        first, last = PLAN.flag_firsts[band:band + 2]
        how.flags[first:last] = np.random.RandomState(seed).rand(last - first) < share
    complete, found = decoded(np.concatenate([coded(how), np.zeros(8, np.uint8)]))
    assert complete and (found.noises == how.noises).all() and (found.flags == how.flags).all()


def test_equal_noises_take_few_bytes_and_flags_that_are_all_set_none() -> None:
    how = prediction.nothing(PLAN)
    how.noises[:], how.flags[:] = 20, 1
    assert len(coded(how)) <= 8


@settings(max_examples=200)
@given(st.binary(max_size=200))
def test_any_bytes_are_a_prediction_or_are_refused(data: bytes) -> None:
    complete, found = decoded(np.frombuffer(data + b'\0', np.uint8).copy())
    assert complete in (True, False)
    assert ((found.noises >= shrinking.NONE) & (found.noises <= shrinking.STRONGEST)).all()


@pytest.mark.parametrize('forged', [shrinking.STRONGEST + 1, shrinking.STRONGEST + 9])
def test_a_noise_that_there_is_not_is_refused(forged: int) -> None:
    how = prediction.nothing(PLAN)
    how.noises[0] = forged
    data = np.zeros(SIZE, np.uint8)
    complete, state = prediction.code_prediction(True, how, PLAN, data, range_coder.begin(True, data, 0))
    assert not complete
    data = data[:range_coder.finish(data, state)]
    assert not decoded(np.concatenate([data, np.full(8, 255, np.uint8)]))[0]
