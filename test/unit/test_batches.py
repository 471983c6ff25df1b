# SPDX-License-Identifier: BSD-3-Clause
import io
from typing import Any

import numpy as np
from std_msgs.msg import String

from smokebot_udp.udpros.batches import MAX_LAYOUTS, BatchReader
from smokebot_udp.udpros.datagram import OVERHEAD

SLOT = 600


def batch(*messages) -> Any:
    """(datagrams, lengths) of serialised messages."""
    rows = np.full((len(messages), SLOT), 255, np.uint8)
    for row, message in zip(rows, messages):
        row[OVERHEAD:OVERHEAD + len(message)] = np.frombuffer(message, np.uint8)
    return rows, np.array([OVERHEAD + len(message) for message in messages])


def text(content) -> Any:
    buffer = io.BytesIO()
    String(content).serialize(buffer)
    return buffer.getvalue()


def test_each_layout_is_a_view_of_its_own() -> None:
    rows, lengths = batch(text('a'), text('bcd'), b'no', text('e'), text('f'), b'\xff\0\0\0g')
    views, bad = BatchReader(String).read(rows, lengths, np.array([True, True, True, True, False, True]))
    assert bad == 2
    assert [mask.tolist() for _, mask in views] == [[True, False, False, True, False, False],
                                                    [False, True, False, False, False, False]]
    assert [records['data'][mask].tobytes() for records, mask in views] == [b'ae', b'bcd']
    assert all(np.shares_memory(records, rows) for records, _ in views)


def test_nothing_to_read() -> None:
    rows, lengths = batch(text('a'))
    assert BatchReader(String).read(rows, lengths, np.array([False])) == ([], 0)


def test_ever_new_lengths_do_not_fill_the_memory() -> None:
    reader = BatchReader(String)
    for length in range(2 * MAX_LAYOUTS):
        rows, lengths = batch(text('x' * length))
        (records, mask), = reader.read(rows, lengths, np.ones(1, bool))[0]
        assert mask.all() and records['data'].tobytes() == b'x' * length
        assert 0 < len(reader) <= MAX_LAYOUTS
