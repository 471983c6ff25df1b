# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.z_order import AXIS_BITS, keys_of, offsets_of

pytestmark = pytest.mark.filterwarnings('error')


def test_keys_by_hand() -> None:
    """With 2, 1 and 3 bits: from the lowest bit on x0 y0 z0 x1 z1 z2."""
    offsets = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [0, 0, 2], [0, 0, 4], [3, 1, 7]])
    keys = keys_of(offsets, (2, 1, 3))
    assert keys.dtype == np.uint64 and keys.tolist() == [1, 2, 4, 8, 16, 32, 63]
    assert offsets_of(keys, (2, 1, 3)).tolist() == offsets.tolist()


def test_points_of_a_cube_follow_each_other() -> None:
    corner = np.array([4, 8, 12])
    cube = np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3)
    keys = np.sort(keys_of(cube + corner, (6, 6, 6)))
    assert np.diff(keys).tolist() == [1] * 63


@settings(deadline=None)
@given(st.tuples(*[st.integers(0, AXIS_BITS)] * 3), st.data())
def test_offsets_come_back(bits, data) -> None:
    offsets = np.array([data.draw(st.tuples(*[st.integers(0, (1 << axis) - 1) for axis in bits])) for _ in range(5)])
    keys = keys_of(offsets, bits)
    assert int(keys.max()) < 1 << sum(bits)
    assert offsets_of(keys, bits).tolist() == offsets.tolist()
