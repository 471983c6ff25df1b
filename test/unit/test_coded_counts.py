# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, List, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.coded_counts import MAX_COUNT, decode, encode
from smokebot_udp.codecs.wire.scan import ScanParts

ROWS = st.lists(st.tuples(st.integers(-3000, 3000) | st.integers(1 - MAX_COUNT, MAX_COUNT - 1),
                          st.sampled_from([0, 0, 0, 0, 1, 2, 3])), min_size=1, max_size=80)


def as_array(data: bytes) -> Any:
    return np.frombuffer(data, np.uint8)


@given(ROWS)
def test_any_row_is_read_again(row: List[Tuple[int, int]]) -> None:
    counts, marks = np.array(row).T
    found = decode(as_array(encode(counts, marks)), len(row))
    np.testing.assert_array_equal(found[1], marks)
    np.testing.assert_array_equal(found[0], np.where(marks == 0, counts, 0))


def test_bytes_by_hand() -> None:
    """7, 8, 10, then nothing twice: runs of 3 and 2, that are 4 * 2 + 0 and 4 * 1 + 1; differences 7, 1, 2, zigzag
    14, 2, 4."""
    data = encode(np.array([7, 8, 10, 0, 0]), np.array([0, 0, 0, 1, 1]))
    runs = [5, 0x00, 0x01, 0x10]        # classes 0..4, words of 1 bit for class 3 and 4
    values = [5, 0x00, 0x22, 0x10]      # of 2, 2 and 1 bits for class 2, 3 and 4
    assert list(data) == [2 | 4, 8, *runs, *values, 0, 0, 2,
                          # class 4: 1, class 3: 0; 8 without its highest bit 000, 5: 01
                          0, 1, 0b10000000, 0b00001000,
                          # class 4: 0, class 2: 10, class 3: 11; 14: 110, 2: 0, 4: 00
                          0, 1, 0b01011000, 0b11000000]
    assert [found.tolist() for found in decode(as_array(data), 5)] == [[7, 8, 10, 0, 0], [0, 0, 0, 1, 1]]


def test_a_slope_takes_less_than_its_differences() -> None:
    row = np.cumsum(np.arange(500) // 2)
    assert len(encode(row, np.zeros(500, int))) < 110


@given(st.binary(max_size=60), st.integers(0, 300))
def test_any_bytes_are_a_row_or_refused(data: bytes, count: int) -> None:
    try:
        counts, marks = decode(as_array(data), count)
    except ValueError:
        return
    assert len(counts) == len(marks) == count
    assert (abs(counts) < MAX_COUNT).all() and ((marks >= 0) & (marks <= 3)).all()


@given(ROWS, st.data())
def test_a_row_with_other_bytes_is_a_row_or_refused(row: List[Tuple[int, int]], data: Any) -> None:
    counts, marks = np.array(row).T
    changed = bytearray(encode(counts, marks))
    for _ in range(data.draw(st.integers(1, 3))):
        changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(changed[:data.draw(st.integers(0, len(changed)))])
    for some in bytes(changed), cut:
        try:
            found, _ = decode(as_array(some), len(row))
        except ValueError:
            continue
        assert (abs(found) < MAX_COUNT).all()


@pytest.mark.parametrize('data', [
    b'', b'\4', b'\10\0', b'\0\0', b'\4\377',
    bytes([4, 2, 1, 0x10]),                                 # no sequence
    bytes([2, 2, 1, 0x10, 255, 255, 255, 0, 1, 0]),         # more runs than bits
    bytes([4, 31, 58, *[0] * 28, 0x01, 0x00, 0, 1, 0])])
def test_broken_rows_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError):
        decode(as_array(data), 200000)


def test_sums_that_overflow_are_refused() -> None:
    """Numbers of 57 bits, again and again, their sums doubled: they wrap around 64 bits."""
    words = [0] * 57 + [1]
    codes = bytes([58]) + bytes(words[i] << 4 | words[i + 1] for i in range(0, 58, 2))
    for count in range(2, 40):
        row = bytes([5, len(codes)]) + codes + (-(-count // 8)).to_bytes(2, 'big') + bytes(-(-count // 8)) + bytes(
            -(-count * 56 // 8))
        with pytest.raises(ValueError, match='counts'):
            decode(as_array(row), count)


def test_broken_parts_are_left_out() -> None:
    good = encode(np.arange(5), np.zeros(5, int))
    scan = ScanParts(10, 2, 255, 0, 1000)
    for part, data in (0, good), (1, b'rubbish'):
        assert scan.add(np.array([part]), as_array(data)[np.newaxis], np.zeros((1, 0), np.uint8)).all()
    ranges, _, _ = scan.merge('nan')
    np.testing.assert_array_equal(ranges[::2], np.float32([0, 0.001, 0.002, 0.003, 0.004]))
    assert np.isnan(ranges[1::2]).all() and scan.broken == 1 and scan.have.tolist() == [True, False]
    scan.add(np.array([0]), as_array(b'rubbish')[np.newaxis], np.zeros((1, 0), np.uint8))
    with pytest.raises(ValueError, match='no part can be read'):
        scan.merge('nan')
