# SPDX-License-Identifier: BSD-3-Clause
"""The erasure code over slices: by hand, any pieces restore all, and hostile pieces."""
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.video.protection import MAX_PIECES, protect, restore

pytest.importorskip('numba')

SLICES = st.lists(st.binary(max_size=60), min_size=1, max_size=20)


def test_the_parity_of_one_slice_by_hand() -> None:
    # 1 / (1 + 0) in GF(256) is 1: piece 1 is the source piece
    assert protect([b'abc'], 1) == [b'\0\3abc']


def test_the_parity_of_two_slices_by_hand() -> None:
    # piece 2: 1 / (2 + 0) = 0x8e and 1 / (2 + 1) = 0xf4; 0x8e * 2 = 0xf4 * 3 = 1
    assert protect([b'\2\2', b'\3'], 1) == [bytes([0, 1 ^ 0xf4, 1 ^ 1, 1])]


@given(SLICES, st.integers(0, 25), st.randoms(use_true_random=False))
@settings(max_examples=150, deadline=None)
def test_any_pieces_restore_the_slices_and_fewer_none_that_did_not_come(slices, parities, random: Random) -> None:
    pieces = [*slices, *protect(slices, parities)]
    came = random.sample(range(len(pieces)), random.randint(0, len(pieces)))
    restored = restore({index: pieces[index] for index in came}, len(slices))
    if len(came) >= len(slices):
        assert [restored[index] for index in range(len(slices))] == slices
    else:
        assert restored == {index: slices[index] for index in came if index < len(slices)}


def test_the_most_pieces() -> None:
    slices = [bytes([number]) * 3 for number in range(100)]
    parity = protect(slices, MAX_PIECES - 100)
    assert list(restore({100 + number: piece for number, piece in enumerate(parity)}, 100).values()) == slices


@pytest.mark.parametrize('slices, parities', [([], 1), ([b'a'], -1), ([b'a'], 255), ([bytes(65536)], 1)])
def test_what_cannot_be_protected(slices, parities) -> None:
    with pytest.raises(ValueError, match='slices with'):
        protect(slices, parities)


@pytest.mark.parametrize('received, count, message', [
    ({0: b''}, 0, 'must be up to'), ({0: b''}, 256, 'must be up to'), ({255: b''}, 1, 'must be up to'),
    ({-1: b''}, 1, 'must be up to'),
    ({0: b'abc', 2: b'1234'}, 2, 'do not belong'),
    ({2: b'1234', 3: b'123'}, 2, 'do not belong'),
    ({2: b'', 3: b''}, 2, 'do not belong'),
    ({1: b'\0\4abc'}, 1, 'slice of 4 bytes')])
def test_pieces_that_contradict_each_other(received, count, message) -> None:
    with pytest.raises(ValueError, match=message):
        restore(received, count)


@given(st.dictionaries(st.integers(0, 30), st.binary(max_size=8), max_size=20), st.integers(1, 20))
@settings(max_examples=300, deadline=None)
def test_hostile_pieces_are_refused_or_give_slices(received, count) -> None:
    try:
        restored = restore(received, count)
    except ValueError:
        return
    assert all(0 <= index < count for index in restored)
