# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('numba')

from smokebot_udp.codecs.layered import wavelet  # noqa: E402

SIDES = st.integers(1, 33)


def test_5_3_of_a_row_by_hand() -> None:
    x = np.array([[1, 5, 3, 8, 2]], np.int32)
    wavelet.split_exactly(x)
    # high: 5 - (1 + 3) // 2 = 3, 8 - (3 + 2) // 2 = 6; low: 1 + (3 + 3 + 2) // 4, 3 + (3 + 6 + 2) // 4, 2 + 14 // 4
    assert x.tolist() == [[3, 5, 5, 3, 6]]


def test_halves_of_rows_stay_interleaved() -> None:
    x = np.array([[10], [10], [10], [30]], np.int32)
    wavelet.split_exactly(x)
    assert x.tolist() == [[10], [0], [15], [20]]


@settings(max_examples=60)
@given(SIDES, SIDES, st.integers(0, 2 ** 32 - 1))
def test_5_3_is_reversible(height: int, width: int, seed: int) -> None:
    pixels = np.random.RandomState(seed).randint(-65536, 65536, (height, width)).astype(np.int32)
    x = pixels.copy()
    wavelet.split_exactly(x)
    wavelet.join_exactly(x)
    assert (x == pixels).all()


@settings(max_examples=60)
@given(SIDES, SIDES, st.integers(0, 2 ** 32 - 1))
def test_9_7_is_reversible_but_for_rounding(height: int, width: int, seed: int) -> None:
    pixels = np.random.RandomState(seed).uniform(-256, 256, (height, width)).astype(np.float32)
    x = pixels.copy()
    wavelet.split(x)
    wavelet.join(x)
    assert np.abs(x - pixels).max() < 1e-3


def test_9_7_of_a_ramp_has_no_details() -> None:
    x = np.tile(np.arange(64, dtype=np.float32), (4, 1))
    wavelet.split(x)
    assert np.abs(x[::2, 34:62]).max() < 1e-3 < np.abs(x[::2, :32]).max()


def test_9_7_nearly_keeps_energy() -> None:
    x = np.random.RandomState(1).normal(0, 1, (128, 128)).astype(np.float32)
    before = float((x ** 2).sum())
    wavelet.split(x)
    assert float((x ** 2).sum()) == pytest.approx(before, rel=0.05)
