# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('numba')

from smokebot_udp.arrays import Array  # noqa: E402
from smokebot_udp.codecs.layered import wavelet  # noqa: E402
from smokebot_udp.codecs.layered.layout import SCALE_9_7  # noqa: E402

SIDES = st.integers(1, 33)
BOTH = pytest.mark.parametrize('steps', [wavelet.STEPS_9_7, wavelet.STEPS_5_3], ids=['9/7', '5/3'])
INT32 = np.iinfo(np.int32)


def split(x: Array, steps: Array) -> Array:
    result = x.astype(np.int32)
    wavelet.split(result, steps)
    return result


def test_5_3_of_a_row_by_hand() -> None:
    # high: 5 - (1 + 3) // 2 = 3, 8 - (3 + 2) // 2 = 6; low: 1 + (3 + 3 + 2) // 4, 3 + (3 + 6 + 2) // 4, 2 + 14 // 4
    assert split(np.array([[1, 5, 3, 8, 2]]), wavelet.STEPS_5_3).tolist() == [[3, 5, 5, 3, 6]]


def test_5_3_rounds_down() -> None:
    # high: 0 - (-1 + 0) // 2 = 1; low: -1 + (1 + 1 + 2) // 4, 0 + (1 + 1 + 2) // 4
    assert split(np.array([[-1, 0, 0]]), wavelet.STEPS_5_3).tolist() == [[0, 1, 1]]


def test_9_7_of_a_row_by_hand() -> None:
    # high: -1.58613 * 4000 = -6345; low: 2000 - 0.05298 * -12690 = 2672; high: -6345 + 0.88291 * 5344 = -1627;
    # low: 2672 + 0.44351 * -3254 = 1229
    assert split(np.array([[2000, 0]]), wavelet.STEPS_9_7).tolist() == [[1229, -1627]]


def test_halves_of_rows_stay_interleaved() -> None:
    assert split(np.array([[10], [10], [10], [30]]), wavelet.STEPS_5_3).tolist() == [[10], [0], [15], [20]]


def lifted(x: Array, steps: Array) -> None:
    """All rows by one step after the other, in Python's integers."""
    for first, factor, half in steps.tolist():
        for y in range(first, len(x), 2):
            above, below = x[y - 1 if y > 0 else 1], x[y + 1 if y + 1 < len(x) else y - 1]
            x[y] += ((above + below) * factor + half) >> wavelet.BITS


@BOTH
@pytest.mark.parametrize('height, width', [(1, 1), (1, 9), (2, 2), (3, 1), (4, 7), (5, 2), (6, 5), (7, 8), (12, 33)])
def test_one_sweep_is_one_step_after_the_other(steps: Array, height: int, width: int) -> None:
    x = np.random.RandomState(1).randint(-60000, 60000, (height, width))
    expected = x.copy()
    if height > 1:
        lifted(expected, steps)
    if width > 1:
        lifted(expected.T, steps)
    assert (split(x, steps) == np.concatenate([expected[:, ::2], expected[:, 1::2]], axis=1)).all()


@BOTH
@settings(max_examples=60)
@given(SIDES, SIDES, st.sampled_from([3, 65536, 1 << 24, INT32.max]), st.integers(0, 2 ** 32 - 1))
def test_it_is_reversible_whatever_overflows(steps: Array, height: int, width: int, spread: int, seed: int) -> None:
    x = np.random.RandomState(seed).randint(-spread, spread, (height, width)).astype(np.int32)
    found = split(x, steps)
    wavelet.join(found, wavelet.inverse(steps))
    assert (found == x).all()


def test_9_7_of_a_ramp_has_no_details() -> None:
    x = split(np.tile(100 * np.arange(64), (4, 1)), wavelet.STEPS_9_7)
    assert np.abs(x[::2, 34:62]).max() <= 2
    assert np.abs(x[::2, :32]).max() > 1000


def test_9_7_scaled_nearly_keeps_energy() -> None:
    before = np.random.RandomState(1).normal(0, 1000, (128, 128))
    x = split(before, wavelet.STEPS_9_7).astype(float)
    scales = np.where(np.arange(128) % 2, SCALE_9_7, 1 / SCALE_9_7)
    x *= scales[:, np.newaxis] * np.sort(scales)[::-1]
    assert float((x ** 2).sum()) == pytest.approx(float((before ** 2).sum()), rel=0.05)
