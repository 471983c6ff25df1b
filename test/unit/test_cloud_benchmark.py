# SPDX-License-Identifier: BSD-3-Clause
"""What the benchmark of clouds computes from what it measures."""
import numpy as np
import pytest

from benchmarks.clouds import DRACO, ENCODINGS, MISSING, mean, ours, table
from evaluation.clouds import distance, message_of, points_of


def test_means_and_what_no_method_has() -> None:
    assert mean([{'a': 1.0, 'b': None}, {'a': 4.0, 'b': 2.0}]) == {'a': 2.5, 'b': None}


def test_the_table_names_what_is_left_out() -> None:
    row = {'bytes a point': 2.034, 'with heads': 2.5, 'datagrams': 7.6, 'encode [ms]': 1.0, 'decode [ms]': 0.5,
           'half lost: p99 [m]': None}
    lines = table({'clouds': {'hall': {'sorted': row}}, 'points': {'hall': 250.4}, 'skipped': {DRACO: MISSING}})
    assert '| hall | 250 | sorted | 2.03 | 2.50 | 8 | 1.00 | 0.50 | – |' in lines.split('\n')
    assert lines.endswith('Draco, whole is left out: DracoPy is not installed')


@pytest.mark.parametrize('encoding', ENCODINGS)
def test_a_cloud_is_measured(encoding: str) -> None:
    points = np.random.RandomState(1).uniform(-5, 5, (3000, 3)).astype(np.float32)
    row = ours(encoding, points, 1)
    least = {'float32': 12.0, 'packed': 4.0, 'sorted': 2.0}[encoding]
    assert least <= row['bytes a point'] < least + 1 < row['with heads'] + 1
    assert row['with heads'] > row['bytes a point'] and 0 < row['half lost: p99 [m]'] < 5


def test_distances_by_hand() -> None:
    whole = np.array([(0, 0, 0), (0, 3, 4)], np.float32)
    assert points_of(message_of(whole)).tolist() == whole.tolist() and len(points_of(None)) == 0
    assert distance(whole, whole) == 0 and distance(whole, whole[:0]) == np.inf
    assert distance(np.repeat(whole, 50, axis=0), whole[:1]) == pytest.approx(5)
