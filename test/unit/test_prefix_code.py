# SPDX-License-Identifier: BSD-3-Clause
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.prefix_code import CLASSES, MAX_LENGTH, UNKNOWN, PrefixCode, best_code, follow, read_codes

pytestmark = pytest.mark.filterwarnings('error')
RFC_1951 = 3, 3, 3, 3, 3, 2, 4, 4
"""The lengths of its example in section 3.2.2."""


def bits_of(code, classes) -> str:
    return ''.join(format(int(code.words[class_]), '0%db' % code.lengths[class_]) for class_ in classes)


def row_of(text: str, size: int) -> np.ndarray:
    return np.frombuffer(int(text.ljust(8 * size, '0'), 2).to_bytes(size, 'big'), np.uint8)


def test_words_of_rfc_1951() -> None:
    code = PrefixCode(RFC_1951)
    assert [bits_of(code, [class_]) for class_ in range(8)] == ['010', '011', '100', '101', '110', '00', '1110', '1111']


def test_a_code_as_bytes_by_hand() -> None:
    assert PrefixCode(RFC_1951).write().hex() == '08' '33333244'
    assert PrefixCode([0, 1, 1]).write().hex() == '03' '0110'
    both = read_codes(bytes.fromhex('0833333244' '030110'), 2)
    assert [code.lengths.tolist() for code in both] == [list(RFC_1951), [0, 1, 1]]


@pytest.mark.parametrize('data, count', [
    ('', 1), ('030110', 2), ('030110', 0), ('0301', 1), ('03011000', 1), ('00', 1), ('0200', 1),
    ('03' '1110', 1),                               # three words of one bit
    ('3b' + '00' * 29 + '10', 1), ('ff' + '11' * 128, 1)])
def test_impossible_codes(data, count) -> None:
    with pytest.raises(ValueError, match='code'):
        read_codes(bytes.fromhex(data), count)


COUNTS = st.lists(st.integers(0, 10 ** 6), min_size=1, max_size=CLASSES).filter(any)


@settings(deadline=None)
@given(COUNTS)
def test_the_best_code_is_within_a_bit_of_the_entropy(counts) -> None:
    code = best_code(np.array(counts))
    used = [count for count in counts if count]
    bits = sum(count * int(length) for count, length in zip(counts, code.lengths))
    entropy = sum(count * math.log2(sum(used) / count) for count in used)
    assert all(length > 0 for count, length in zip(counts, code.lengths) if count)
    assert entropy - 1e-6 * bits <= bits <= entropy + sum(used)


def test_words_are_no_longer_than_they_may_be() -> None:
    """Fibonacci's numbers have the longest words of all."""
    counts = [1, 1]
    while len(counts) < 40:
        counts.append(counts[-1] + counts[-2])
    code = best_code(np.array(counts))
    assert code.lengths.max() <= MAX_LENGTH and code.lengths.min() >= 1
    read_codes(code.write(), 1)


@settings(deadline=None)
@given(COUNTS, st.integers(1, 70), st.data())
def test_chains_of_words_are_followed(counts, most, data) -> None:
    code = best_code(np.array(counts))
    classes = st.sampled_from(np.flatnonzero(code.lengths).tolist())
    chains = data.draw(st.lists(st.lists(classes, min_size=1, max_size=most), min_size=1, max_size=4))
    texts = [bits_of(code, chain) for chain in chains]
    size = max(map(len, texts)) // 8 + 1
    found, ends = follow(code, np.stack([row_of(text, size) for text in texts]), np.array(list(map(len, chains))))
    assert [row[:len(chain)].tolist() for row, chain in zip(found, chains)] == chains
    assert ends.tolist() == list(map(len, texts))


def test_what_is_no_word_is_unknown() -> None:
    code = PrefixCode([2, 2, 2])    # 11 is none
    found, _ = follow(code, row_of('0001' '1100', 1)[np.newaxis], np.array([4]))
    assert found.tolist() == [[0, 1, UNKNOWN, UNKNOWN]]


def test_a_chain_ends_with_its_row() -> None:
    code = PrefixCode([1, 1])
    found, ends = follow(code, np.array([[255], [0]], np.uint8), np.array([40, 3]))
    assert found.shape == (2, 40) and found[0, 30] == UNKNOWN and ends[0] > 8
    assert found[1, :3].tolist() == [0, 0, 0] and ends[1] == 3
    found, ends = follow(code, np.zeros((2, 0), np.uint8), np.array([9, 9]))
    assert (ends > 0).all() and found.shape == (2, 9)
