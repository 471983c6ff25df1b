# SPDX-License-Identifier: BSD-3-Clause
import itertools
from typing import Any

import numpy as np
import pytest

pytest.importorskip('numba')

from smokebot_udp.codecs.layered import class_map  # noqa: E402
from smokebot_udp.codecs.layered.depth import from_counts, to_counts  # noqa: E402
from smokebot_udp.codecs.layered.image import Decoded, decode, encode  # noqa: E402


def test_counts_by_hand() -> None:
    depth = np.array([[0.0, 0.0014, 2.0], [70.0, -1.0, 65.535]], np.float32)
    counts, classes = to_counts(depth, 0.001)
    assert counts.tolist() == [[0, 1, 2000], [65535, 0, 65535]]
    assert counts.dtype == np.uint16
    assert classes is None
    assert from_counts(Decoded(counts, None), 0.001)[0, 2] == np.float32(2.0)


def test_nan_and_infinities_stay() -> None:
    depth = np.random.RandomState(1).uniform(0.5, 5, (30, 40)).astype(np.float32)
    depth[3:9, 5:20], depth[20:, :7], depth[0, 0] = np.nan, np.inf, -np.inf
    counts, classes = to_counts(depth, 0.001)
    stream = encode(counts, True, 1 << 20, classes)
    for end in (stream.ends[0], len(stream.data)):
        result = decode(stream.data[:end], 30, 40, 1, 2)
        assert result is not None
        found = from_counts(result, 0.001)
        assert (np.isnan(found) == np.isnan(depth)).all()
        assert (np.isinf(found) == np.isinf(depth)).all()
        assert found[0, 0] == -np.inf
    finite = np.isfinite(depth)
    assert np.abs(found[finite] - depth[finite]).max() < 0.00051


def holes(share: float) -> Any:
    """(counts, classes) of a slope of which a share, scattered, is not finite."""
    random = np.random.RandomState(2)
    depth = np.add.outer(np.arange(120), 2.0 * np.arange(161)).astype(np.float32) + 500
    depth[random.random_sample(depth.shape) < share] = np.nan
    depth[:2, :3] = -np.inf
    return to_counts(depth, 1.0)


@pytest.mark.parametrize('share', [0.05, 0.5, 0.95])
@pytest.mark.parametrize('lossless', [False, True], ids=['9/7', '5/3'])
@pytest.mark.parametrize('budget', [1, 20, 30, 100, 400, 600, 3000, 20000, 1 << 17])
def test_scattered_holes_never_take_the_whole_budget(share: float, lossless: bool, budget: int) -> None:
    counts, classes = holes(share)
    stream = encode(counts, lossless, budget, classes)
    assert len(stream.data) <= max(budget, 12)
    assert stream.ends[0] <= max(budget / 4, 28) or stream.missing == 0
    for end in (stream.ends[0], len(stream.data)):
        assert decode(stream.data[:end], 120, 161, 1, 2) is not None
    result = decode(stream.data, 120, 161, 1, 2)
    found = result.classes if result.classes is not None else np.zeros_like(classes)
    assert (found == classes).all() == (stream.missing == 0)
    error = float(((result.pixels - counts.astype(float)) ** 2).sum() + (found != classes).sum())
    assert stream.errors[-1] == pytest.approx(error, rel=0.5) and (stream.errors > 0).all() or error == 0
    if budget == 1 << 17:
        assert stream.missing == 0 and (not lossless or stream.errors[-1] == 0)


def test_a_coarse_map_is_of_what_most_cells_of_a_block_are() -> None:
    classes = np.zeros((6, 5), np.uint8)
    classes[:2, :2], classes[2:4, :2], classes[2, 2], classes[4:, 4] = [[1, 1], [1, 0]], [[3, 3], [2, 3]], 1, 2
    first, second = itertools.islice(class_map.reductions(classes), 2)
    assert first.tolist() == [[1, 0, 0], [3, 0, 0], [0, 0, 2]]
    assert second.tolist() == [[0, 0], [0, 2]]
    assert class_map.enlarged(first, 1, 6, 5)[:, 0].tolist() == [1, 1, 3, 3, 0, 0]


def test_exact_maps_come_where_the_whole_stream_fits_though_they_are_most_of_it() -> None:
    classes = (np.random.RandomState(4).random_sample((100, 100)) < 0.3).astype(np.uint8)
    flat = np.full((100, 100), 900, np.uint16)
    whole = encode(flat, True, 1 << 20, classes)
    tight = encode(flat, True, len(whole.data) + 4, classes)
    assert tight.missing == whole.missing == 0 and tight.data == whole.data
    short = encode(flat, True, len(whole.data) // 2, classes)
    assert short.missing > len(whole.data) / 2 and short.errors[-1] > 0


def test_what_is_not_finite_is_filled_from_its_neighbours() -> None:
    depth = np.array([[10, np.nan, np.nan], [20, np.nan, 40], [np.nan, 8, np.inf]], np.float32)
    counts, _ = to_counts(depth, 1.0)
    assert counts.tolist() == [[10, 10, 10], [20, 15, 40], [20, 8, 24]]


def test_nothing_finite() -> None:
    counts, classes = to_counts(np.full((2, 3), np.nan, np.float32), 0.01)
    assert classes is not None
    assert np.isnan(from_counts(Decoded(counts, classes), 0.01)).all()


@pytest.mark.parametrize('unit', [0.0, -1.0, float('nan')])
def test_a_unit_that_is_not_positive_is_refused(unit: float) -> None:
    with pytest.raises(ValueError):
        to_counts(np.zeros((2, 2), np.float32), unit)
