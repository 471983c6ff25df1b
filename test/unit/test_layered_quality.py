# SPDX-License-Identifier: BSD-3-Clause
"""Errors as bytes: golden values, limits, precision."""
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.codecs.layered.quality import from_byte, to_byte


@pytest.mark.parametrize('rms, byte', [(0.0, 0), (1e-300, 1), (2.0 ** -6, 1), (1.0, 67), (2.0, 78), (65535.0, 243),
                                       (1e300, 255), (math.inf, 255)])
def test_golden_bytes(rms, byte) -> None:
    assert to_byte(rms) == byte


def test_all_bytes_come_back() -> None:
    assert [to_byte(from_byte(byte)) for byte in range(256)] == list(range(256))
    assert from_byte(0) == 0.0 and from_byte(67) == 1.0


@given(st.floats(2.0 ** -6, 65535.0))
def test_precision(rms: float) -> None:
    assert from_byte(to_byte(rms)) == pytest.approx(rms, rel=0.033)


@pytest.mark.parametrize('rms', [-1.0, -1e-300, math.nan])
def test_impossible_errors(rms) -> None:
    with pytest.raises(ValueError, match='rms'):
        to_byte(rms)


@pytest.mark.parametrize('byte', [-1, 256])
def test_impossible_bytes(byte) -> None:
    with pytest.raises(ValueError, match='byte'):
        from_byte(byte)
