# SPDX-License-Identifier: BSD-3-Clause
"""A new address gets no more than it sent, and proves itself with the challenge."""
import numpy as np
import pytest

from smokebot_udp.link.control import (
    CHALLENGE_SIZE,
    COPY,
    SECOND,
    SIZE,
    Control,
    marked,
    message,
    with_mark,
    without_marks,
)
from smokebot_udp.link.path import AGAIN, LEFT_AFTER, PathCheck

HERE, THERE = (1, 2), (1, 3)


def test_never_more_than_came_from_there() -> None:
    path = PathCheck(THERE, b'12345678')
    assert not path.may_send(48, 1.0)
    path.came(47, 1.0)
    assert not path.may_send(48, 1.0)
    path.came(50, 1.0)
    assert path.may_send(48, 1.0)
    assert not path.may_send(48, 1.0 + AGAIN / 2)
    assert path.may_send(48, 1.0 + 2 * AGAIN)
    assert not path.may_send(48, 9.0)


def test_only_the_challenge_from_that_address_is_the_proof() -> None:
    path = PathCheck(THERE, b'12345678')
    assert path.is_proof(THERE, b'12345678')
    assert not path.is_proof(HERE, b'12345678') and not path.is_proof(THERE, b'12345679')


def test_who_has_not_been_heard_from_there_for_a_while_has_left() -> None:
    path = PathCheck(THERE, b'12345678')
    path.came(50, 1.0)
    assert not path.has_left(1.0 + LEFT_AFTER / 2) and path.has_left(1.1 + LEFT_AFTER)


def test_a_challenge_has_eight_bytes() -> None:
    with pytest.raises(ValueError):
        PathCheck(THERE, b'1234567')


def test_the_bytes_of_the_cores_own_messages() -> None:
    assert message(Control.KEEP_ALIVE).hex() == '00000000' '00' '00' '0100' '0000000000000000'
    assert message(Control.PATH_CHALLENGE, b'12345678').hex() == '01000000' '00' '00' '0100' + b'12345678'.hex()
    assert len(message(Control.CLOSE)) == SIZE == 8 + CHALLENGE_SIZE


def test_a_copy_is_marked_in_its_op() -> None:
    datagram = bytes.fromhex('78563412' '00' '07' '0100' 'aabb')
    original = np.frombuffer(datagram, np.uint8)[np.newaxis]
    copy = with_mark(original, COPY)
    assert copy.tobytes() == bytes.fromhex('78563412' '80' '07' '0100' 'aabb')
    both = np.concatenate([original, copy])
    assert marked(both, COPY).tolist() == [False, True] and not marked(both, SECOND).any()
    assert without_marks(copy).tobytes() == datagram == original.tobytes()
