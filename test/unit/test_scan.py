# SPDX-License-Identifier: BSD-3-Clause
from typing import Iterable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.scan import (
    MAX_RANGES,
    ScanParts,
    densest_comb,
    fit,
    in_millimetres,
    read_intensities,
    read_ranges,
    write_intensities,
    write_ranges,
)

# by their bits: NaNs of every kind, -0.0 and denormals too; and what scanners measure
BITS = st.integers(0, 2 ** 32 - 1).map(lambda bits: np.uint32(bits).view(np.float32))
MEASURED = (st.integers(0, 70000).map(lambda count: in_millimetres(np.array(count)))
        | st.sampled_from(np.float32([0, -0.0, np.inf, -np.inf, np.nan, 1e-45, -1e-45, 3.4e38])))
FLOATS = st.lists(BITS | MEASURED, max_size=50).map(np.float32) | st.lists(MEASURED, max_size=50).map(np.float32)


def meaning(values) -> bytes:
    """The bits of floats; the sign of a NaN or a zero says nothing, nor do the rest of a NaN's bits."""
    return np.where(np.isnan(values), np.float32('nan'), values + np.float32(0)).tobytes()


@given(FLOATS)
def test_any_range_is_exact(ranges) -> None:
    assert read_ranges(write_ranges(ranges)).tobytes() == meaning(ranges)


@given(st.lists(MEASURED.filter(lambda value: not 0 < abs(value) < 1e-4 and not 65.532 < value < np.inf), min_size=1),
       st.sampled_from([0xffc00000, 0x7fc00001, 0xff800001, 0x80000000]))
def test_bits_without_a_meaning_cost_nothing(ranges, bits) -> None:
    """A compiler makes NaNs with a sign, as 0.0 / 0.0 is on x86."""
    odd = np.append(np.float32(ranges), np.uint32(bits).view(np.float32))
    assert write_ranges(odd).shape == (len(odd), 2)


def test_a_minus_zero_among_intensities_costs_nothing() -> None:
    assert write_intensities(np.float32([-0.0, 255.0])).shape == (2, 1)


@given(st.lists(st.integers(0, 65532), max_size=50))
def test_any_whole_millimetres_take_two_bytes(counts) -> None:
    assert write_ranges(in_millimetres(np.array(counts, int))).shape == (len(counts), 2)


@given(FLOATS | st.lists(st.integers(0, 66000), max_size=50).map(np.float32))
def test_any_intensity_is_exact(intensities) -> None:
    assert read_intensities(write_intensities(intensities)).tobytes() == meaning(intensities)


def test_millimetres_take_two_bytes_and_rep_117_with_them() -> None:
    ranges = in_millimetres(np.array([0, 1, 1234, 65532]))
    ranges = np.append(ranges, np.float32([np.inf, -np.inf, np.nan]))
    written = write_ranges(ranges)
    assert written.shape == (7, 2)
    np.testing.assert_array_equal(read_ranges(written), ranges)
    assert write_ranges(np.float32([65.533])).shape == (1, 4)     # that number means something else
    assert write_ranges(np.float32([1.00005])).shape == (1, 4)


@pytest.mark.parametrize('values, size', [([0, 255], 1), ([0, 256], 2), ([0.5], 4), ([-1], 4), ([np.nan], 4),
                                          ([7e4], 4)])
def test_intensities_take_what_they_need(values, size) -> None:
    values = np.float32(values)
    written = write_intensities(values)
    assert written.shape[1] == size
    np.testing.assert_array_equal(read_intensities(written), values)


def test_two_parts_or_as_many_as_it_takes() -> None:
    assert fit(720, 2, 1390) == 2 and fit(681, 4, 1390) == 2
    assert fit(720, 4, 1390) == 4 and fit(20000, 4, 1390) == 64 and fit(1, 4, 1390) == 1
    assert fit(3, 4, 4) == 3      # 4 parts of 3 ranges are none


@given(st.integers(1, MAX_RANGES), st.sampled_from([2, 3, 4, 6, 8]), st.integers(0, 1500))
def test_as_few_parts_as_fit(total, size, spare) -> None:
    parts = fit(total, size, size + spare)
    assert 1 <= parts <= total and -(-total // parts) * size <= size + spare
    assert parts <= 2 or -(-total // ((parts + 1) // 2)) * size > size + spare


def test_what_fits_in_no_parts() -> None:
    with pytest.raises(ValueError, match='262145 ranges are more than'):
        fit(MAX_RANGES + 1, 2, 1390)
    with pytest.raises(ValueError, match='8 bytes does not fit in 7'):
        fit(1, 8, 7)


@given(st.lists(st.booleans(), min_size=1, max_size=16).filter(any))
def test_the_densest_comb(have) -> None:
    first, step = densest_comb(np.array(have))
    assert len(have) % step == 0 and all(have[first::step])
    denser = [(f, s) for s in range(1, step) if len(have) % s == 0 for f in range(s) if all(have[f::s])]
    assert not denser


def parts_of(ranges: Sequence[float], parts: int, received: Iterable[int]) -> ScanParts:
    gathered = ScanParts(len(ranges), parts, 4, 0)
    data = np.ascontiguousarray(np.float32(ranges)).view(np.uint8).reshape(-1, 4)
    for part in received:
        good = gathered.add(np.array([part]), data[part::parts].reshape(1, -1), np.zeros((1, 0), np.uint8))
        assert good.all()
    return gathered


def test_one_half_lost() -> None:
    gathered = parts_of([1, 2, 3, 4, 5], 2, [1])
    ranges, intensities, comb = gathered.merge('nan')
    np.testing.assert_array_equal(ranges, np.float32([np.nan, 2, np.nan, 4, np.nan]))
    assert intensities is None and comb == (0, 1) and gathered.awaited == 0 and not gathered.complete
    ranges, _, comb = gathered.merge('thin')
    assert ranges.tolist() == [2, 4] and comb == (1, 2)


def test_three_of_four_parts_make_every_second_range() -> None:
    ranges, _, comb = parts_of(range(8), 4, [0, 1, 2]).merge('thin')
    assert ranges.tolist() == [0, 2, 4, 6] and comb == (0, 2)
    ranges, _, comb = parts_of(range(7), 4, [0, 1, 3]).merge('thin')
    assert ranges.tolist() == [1, 3, 5] and comb == (1, 2)
    ranges, _, comb = parts_of(range(7), 4, [1, 2]).merge('thin')
    assert ranges.tolist() == [1, 5] and comb == (1, 4)


def test_lost_ranges_lose_their_intensities() -> None:
    gathered = ScanParts(6, 4, 2, 1)
    for part, ranges, intensities in (0, [1000, 1004], [7, 8]), (3, [1003], [9]):
        assert gathered.add(np.array([part]), np.array([ranges], '<u2').view(np.uint8),
                            np.array([intensities], np.uint8)).all()
    assert gathered.completeness == 0.5 and gathered.awaited == 2
    ranges, intensities, comb = gathered.merge('nan')
    assert ranges.tobytes() == np.float32([1.0, np.nan, np.nan, 1.003, 1.004, np.nan]).tobytes() and comb == (0, 1)
    np.testing.assert_array_equal(intensities, np.float32([7, np.nan, np.nan, 9, 8, np.nan]))


@given(st.integers(1, 40), st.integers(1, 40), st.sampled_from(['nan', 'thin']), st.randoms())
def test_all_parts_in_any_order_make_the_exact_scan(total, parts, gaps, random) -> None:
    parts = min(parts, total)
    ranges = np.random.RandomState(total).rand(total).astype(np.float32)
    merged, intensities, comb = parts_of(ranges, parts, random.sample(range(parts), parts)).merge(gaps)
    assert merged.tobytes() == ranges.tobytes() and intensities is None and comb == (0, 1)


@pytest.mark.parametrize('numbers', [(0, 2, 4, 0), (0, 0, 4, 0), (5, 0, 4, 0), (5, 6, 4, 0), (2 ** 32 - 1, 2, 4, 0),
                                     (5, 2, 3, 0), (5, 2, 4, 5), (5, 2, 255, 0), (5, 2, 255, 0, 10 ** 6 + 1),
                                     (5, 2, 4, 0, 1000)])
def test_impossible_scans_are_refused(numbers) -> None:
    with pytest.raises(ValueError):
        ScanParts(*numbers)


def test_parts_that_do_not_fit_are_dropped() -> None:
    gathered = ScanParts(5, 2, 4, 1)
    for part, ranges, intensities in ((2, 12, 3), (0, 11, 3), (0, 12, 2), (65535, 8, 2)):
        assert not gathered.add(np.array([part]), np.zeros((1, ranges), np.uint8),
                                np.zeros((1, intensities), np.uint8)).any()
