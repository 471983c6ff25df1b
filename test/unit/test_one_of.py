# SPDX-License-Identifier: BSD-3-Clause
"""Percentiles that are one of the values."""
import pytest

from evaluation.one_of import percentile


@pytest.mark.parametrize('values, percent, wanted', [
    ([5.0], 99, 5.0), ([3.0, 1.0, 2.0], 50, 2.0), ([1.0, 2.0], 50, 2.0), ([4.0, 1.0, 3.0, 2.0], 0, 1.0),
    ([4.0, 1.0, 3.0, 2.0], 34, 3.0), ([4.0, 1.0, 3.0, 2.0], 100, 4.0), ((float(n) for n in range(101)), 99, 99.0)])
def test_percentiles_by_hand(values, percent, wanted) -> None:
    assert percentile(values, percent) == wanted


def test_none_of_nothing() -> None:
    with pytest.raises(ValueError, match='no values'):
        percentile([], 50)
