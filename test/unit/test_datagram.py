# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.udpros.datagram import (
    DEFAULT_MAX_DATAGRAM_SIZE,
    HEADER,
    HEADER_DTYPE,
    OVERHEAD,
    Op,
    message_ids,
    split,
)


def datagrams(joined, size) -> Any:
    return [bytes(joined[at:at + size]) for at in range(0, len(joined), size)]


def test_one_datagram_by_hand() -> None:
    message = bytes.fromhex('07000000') + b'\3\0\0\0abc'      # std_msgs/String 'abc', and its length before it
    assert bytes(split(message, 0x01020304, 0x2a, 1472)) == bytes.fromhex(
        '04030201'      # connection_id, least significant byte first
        '00'            # DATA0
        '2a'            # message_id
        '0100'          # of 1 block
        '07000000'      # the message's length
        '03000000616263')


def test_three_datagrams_by_hand() -> None:
    message = bytes(range(130))
    assert datagrams(split(message, 5, 255, 64), 64) == [
        bytes.fromhex('05000000' '00' 'ff' '0300') + bytes(range(56)),
        bytes.fromhex('05000000' '01' 'ff' '0100') + bytes(range(56, 112)),
        bytes.fromhex('05000000' '01' 'ff' '0200') + bytes(range(112, 130))]


@pytest.mark.parametrize(('length', 'blocks', 'total'), [
    (0, 1, 8), (1464, 1, 1472), (1465, 2, 1472 + 9), (2 * 1464, 2, 2 * 1472), (20000, 14, 20000 + 14 * 8)])
def test_blocks_of_1472(length, blocks, total) -> None:
    joined = split(bytes(length), 1, 1, 1472)
    assert len(joined) == total
    assert HEADER.unpack_from(joined) == (1, Op.DATA0, 1, blocks)


def test_the_longest_message_of_one_datagram() -> None:
    assert DEFAULT_MAX_DATAGRAM_SIZE - OVERHEAD == 1460


def test_no_more_than_65535_blocks() -> None:
    joined = split(bytes(0xffff * 56), 1, 1, 64)
    assert HEADER.unpack_from(joined) == (1, Op.DATA0, 1, 0xffff)
    assert HEADER.unpack_from(joined, 64 * 0xfffe) == (1, Op.DATAN, 1, 0xfffe)
    with pytest.raises(ValueError, match='65536 blocks'):
        split(bytes(0xffff * 56 + 1), 1, 1, 64)


@given(st.binary(max_size=5000), st.integers(64, 1500))
def test_the_payloads_joined_are_the_message(message, size) -> None:
    pieces = datagrams(split(message, 9, 3, size), size)
    assert b''.join(piece[HEADER.size:] for piece in pieces) == message
    assert [HEADER.unpack_from(piece) for piece in pieces] == [(9, Op.DATA0, 3, len(pieces))] + [
        (9, Op.DATAN, 3, block) for block in range(1, len(pieces))]
    assert all(len(piece) == size for piece in pieces[:-1])
    assert len(pieces) == 1 or len(pieces[-1]) > HEADER.size


def test_message_ids_run_from_1_to_255_and_never_0() -> None:
    assert message_ids(0, 3).tolist() == [1, 2, 3]
    assert message_ids(253, 4).tolist() == [254, 255, 1, 2]
    assert message_ids(255, 1).tolist() == [1]
    assert message_ids(7, 600).tolist() == [i % 255 + 1 for i in range(7, 607)]
    assert message_ids(7, 1).dtype == np.uint8


def test_the_two_header_layouts_are_one() -> None:
    data = HEADER.pack(0x7fffffff, Op.ERR, 255, 0xfffe)
    assert HEADER_DTYPE.itemsize == HEADER.size == 8
    assert np.frombuffer(data, HEADER_DTYPE)[0].item() == (0x7fffffff, 3, 255, 0xfffe)
