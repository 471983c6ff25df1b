# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('numba')

from smokebot_udp.arrays import Array  # noqa: E402
from smokebot_udp.codecs.layered import wavelet  # noqa: E402
from smokebot_udp.codecs.layered.layout import HH, HL, LH, ORIGIN, SCALE_9_7  # noqa: E402

SIDES = st.integers(1, 33)
BOTH = pytest.mark.parametrize('steps', [wavelet.STEPS_9_7, wavelet.STEPS_5_3], ids=['9/7', '5/3'])
INT32 = np.iinfo(np.int32)


def bands(rows: int, columns: int) -> Array:
    """HL, LH and HH on a canvas of the shape of the image: where its quarters are."""
    table = np.zeros((3, ORIGIN + 1), np.int64)
    table[[HL, LH, HH], ORIGIN] = ((columns + 1) // 2, (rows + 1) // 2 * columns,
                                   (rows + 1) // 2 * columns + (columns + 1) // 2)
    return table


def split(x: Array, steps: Array, offset: int = 0, fraction: int = 0) -> Array:
    """[[LL, HL], [LH, HH]]"""
    rows, columns = x.shape
    low, canvas = np.zeros((-(-rows // 2), -(-columns // 2)), np.int32), np.zeros(x.size, np.int32)
    source = x if x.dtype == np.uint8 else x.astype(np.int32)
    wavelet.split(source.reshape(-1), (rows, columns), (offset, fraction), steps, low.reshape(-1), canvas,
                  bands(rows, columns), columns)
    quarters = canvas.reshape(x.shape)
    quarters[:low.shape[0], :low.shape[1]] = low
    return quarters


def joined(quarters: Array, steps: Array, rounding: Tuple[int, int, int] = (0, 0, 0), kind: type = np.int32) -> Array:
    rows, columns = quarters.shape
    low = quarters[:-(-rows // 2), :-(-columns // 2)].reshape(-1)
    result: Array = np.zeros(quarters.size, kind)
    wavelet.join(low, quarters.reshape(-1), bands(rows, columns), columns, wavelet.inverse(steps), rounding, result,
                 (rows, columns))
    return result.reshape(rows, columns)


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


def test_5_3_of_a_column_by_hand() -> None:
    assert split(np.array([[10], [10], [10], [30]]), wavelet.STEPS_5_3).tolist() == [[10], [15], [0], [20]]


def test_pixels_become_parts_of_counts_and_back() -> None:
    # (3 - 2) * 4 and (7 - 2) * 4: high: 20 - 4; low: 4 + (16 + 16 + 2) // 4
    pixels = np.array([[3, 7]], np.uint8)
    quarters = split(pixels, wavelet.STEPS_5_3, 2, 2)
    assert quarters.tolist() == [[12, 16]]
    # 1/4 less or more rounds to the same; 1/2 more does not
    for added, expected in ((-1, [[3, 7]]), (0, [[3, 7]]), (1, [[3, 7]]), (2, [[4, 8]])):
        assert joined(quarters + np.array([[added, 0]], np.int32), wavelet.STEPS_5_3, (2 * 4 + 2, 2, 255),
                      np.uint8).tolist() == expected


def test_pixels_are_clipped() -> None:
    # also where 32 bits overflow: 2^31 - 1 is above any pixel
    values = np.array([[INT32.max, 300, 255, 0, -1, INT32.min]], np.int32)
    found = joined(split(values, wavelet.STEPS_5_3), wavelet.STEPS_5_3, (32, 0, 255), np.uint8)
    assert found.tolist() == [[255, 255, 255, 32, 31, 0]]


@pytest.mark.parametrize('steps', [wavelet.STEPS_5_3, wavelet.inverse(wavelet.STEPS_5_3)], ids=['split', 'join'])
@given(st.lists(st.integers(int(INT32.min), int(INT32.max)), min_size=3, max_size=3))
def test_5_3_in_32_bits_is_that_in_64(steps: Array, values: Any) -> None:
    for number, (_, factor, added, halvings) in enumerate(steps.tolist()):
        ring = np.zeros((3, 1), np.int32)
        ring[:, 0] = values
        wavelet.lift(ring, 1, 0, 2, steps, number)
        total = int(np.int64(values[0] + values[2]).astype(np.int32))
        expected = np.int64(values[1] + ((total * factor + added) >> wavelet.BITS)).astype(np.int32)
        assert halvings and ring[1, 0] == expected


def lifted(x: Array, steps: Array) -> None:
    """All rows by one step after the other, in Python's integers."""
    for first, factor, half, _ in steps.tolist():
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
    columns = np.concatenate([expected[:, ::2], expected[:, 1::2]], axis=1)
    assert (split(x, steps) == np.concatenate([columns[::2], columns[1::2]])).all()


@BOTH
@settings(max_examples=60)
@given(SIDES, SIDES, st.sampled_from([3, 65536, 1 << 24, INT32.max]), st.integers(0, 2 ** 32 - 1))
def test_it_is_reversible_whatever_overflows(steps: Array, height: int, width: int, spread: int, seed: int) -> None:
    x = np.random.RandomState(seed).randint(-spread, spread, (height, width)).astype(np.int32)
    assert (joined(split(x, steps), steps) == x).all()


def test_9_7_of_a_ramp_has_no_details() -> None:
    x = split(np.tile(100 * np.arange(64), (4, 1)), wavelet.STEPS_9_7)
    assert np.abs(x[:2, 34:62]).max() <= 2
    assert np.abs(x[:2, :32]).max() > 1000


def test_9_7_scaled_nearly_keeps_energy() -> None:
    before = np.random.RandomState(1).normal(0, 1000, (128, 128))
    x = split(before, wavelet.STEPS_9_7).astype(float)
    scales = np.where(np.arange(128) < 64, 1 / SCALE_9_7, SCALE_9_7)
    x *= scales[:, np.newaxis] * scales
    assert float((x ** 2).sum()) == pytest.approx(float((before ** 2).sum()), rel=0.05)
