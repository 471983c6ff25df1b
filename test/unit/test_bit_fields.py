# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.bit_fields import MAX_WIDTH, PADDING, FieldWriter, bit_lengths, read, unzigzag, zigzag

pytestmark = pytest.mark.filterwarnings('error')


def test_fields_by_hand() -> None:
    """3 bits of 5, none, 9 bits of 257, and 4 of 15 from bit 20 on: 101 10000 0001 0000 0000 1111."""
    writer = FieldWriter(4)
    writer.write(np.array([0, 3, 3]), np.array([3, 0, 9]), np.array([5, 0, 257]))
    writer.write(np.array([[20]]), np.array([[4]]), np.array([[15]]))
    assert writer.data().tobytes().hex() == 'b0100f00'


FIELDS = st.lists(st.tuples(st.integers(0, 40), st.integers(0, 64)), min_size=1, max_size=30)


@settings(deadline=None)
@given(FIELDS, st.data())
def test_what_is_written_is_what_python_writes(fields, data) -> None:
    """Gaps and widths of fields that follow each other."""
    values = [data.draw(st.integers(0, (1 << width) - 1)) for _, width in fields]
    text, positions = '', []
    for (gap, width), value in zip(fields, values):
        text += '0' * gap
        positions.append(len(text))
        text += format(value, '0%db' % width) if width else ''
    size = len(text) // 8 + 1 + PADDING
    writer = FieldWriter(size)
    widths = np.array([width for _, width in fields])
    writer.write(np.array(positions), widths, np.array(values, np.uint64))
    written = writer.data()
    assert written.tobytes() == int(text.ljust(8 * size, '0'), 2).to_bytes(size, 'big')
    short = widths <= MAX_WIDTH
    back = read(written, np.array(positions)[short], widths[short])
    assert back.tolist() == [value for value, width in zip(values, widths) if width <= MAX_WIDTH]


def test_zigzag_by_hand() -> None:
    assert zigzag(np.array([0, -1, 1, -2, 2, -32, 31])).tolist() == [0, 1, 2, 3, 4, 63, 62]
    assert unzigzag(np.arange(6, dtype=np.uint64)).tolist() == [0, -1, 1, -2, 2, -3]


@given(st.integers(-2 ** 60, 2 ** 60))
def test_zigzag_is_undone(number) -> None:
    assert unzigzag(zigzag(np.array([number]))).tolist() == [number]


@given(st.integers(0, 2 ** 53 - 1))
def test_bit_lengths(number) -> None:
    assert bit_lengths(np.array([number], np.uint64)).tolist() == [number.bit_length()]
