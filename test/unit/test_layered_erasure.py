# SPDX-License-Identifier: BSD-3-Clause
"""The erasure code: arithmetic by hand, and any t of n pieces restore the source."""
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('numba')

from smokebot_udp.arrays import UInt8Array  # noqa: E402
from smokebot_udp.codecs.layered.erasure import extend, product, recover  # noqa: E402


def times(one: int, other: int) -> int:
    """The product in GF(256), bit by bit."""
    result = 0
    for bit in range(8):
        if other >> bit & 1:
            result ^= one << bit
    for bit in range(14, 7, -1):
        if result >> bit & 1:
            result ^= 0x11d << (bit - 8)
    return result


def random_bytes(seed: int, *shape: int) -> UInt8Array:
    return np.random.RandomState(seed).randint(0, 256, shape).astype(np.uint8)


def test_all_products_bit_by_bit() -> None:
    column = np.arange(256, dtype=np.uint8)[:, np.newaxis]
    assert product(column, column.T).tolist() == [[times(one, other) for other in range(256)] for one in range(256)]


def test_parity_by_hand() -> None:
    # piece 2 of 2 source pieces: 1 / (2 + 0) and 1 / (2 + 1) in GF(256) are 0x8e and 0xf4
    assert (times(0x8e, 2), times(0xf4, 3)) == (1, 1)
    source = np.array([[1, 0, 7], [0, 1, 9]], np.uint8)
    assert extend(source, 3).tolist() == [[0x8e, 0xf4, times(0x8e, 7) ^ times(0xf4, 9)]]


def test_one_piece_is_repeated_up_to_a_factor() -> None:
    source = random_bytes(1, 1, 5)
    for index, piece in enumerate(extend(source, 4), 1):
        assert recover(np.array([index]), piece[np.newaxis]).tolist() == source.tolist()


@given(st.integers(1, 256), st.integers(1, 256), st.integers(0, 40), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_any_pieces_restore_the_source(one: int, other: int, size: int, random: Random) -> None:
    threshold, count = sorted((one, other))
    source = random_bytes(random.randrange(1000), threshold, size)
    pieces = np.vstack([source, extend(source, count)])
    indexes = np.array(random.sample(range(count), threshold))
    assert recover(indexes, pieces[indexes]).tolist() == source.tolist()


@pytest.mark.parametrize('threshold, count', [(0, 4), (5, 4), (4, 257)])
def test_impossible_numbers_of_pieces(threshold, count) -> None:
    with pytest.raises(ValueError, match='pieces of'):
        extend(random_bytes(1, threshold, 3), count)


@pytest.mark.parametrize('indexes', [[0, 0], [0, 256], [-1, 0], [0], [], [0, 1, 2]])
def test_impossible_indexes(indexes) -> None:
    with pytest.raises(ValueError, match='indexes'):
        recover(np.array(indexes, int), random_bytes(1, 2, 3))
