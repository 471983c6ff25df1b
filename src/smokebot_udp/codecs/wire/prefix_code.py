# SPDX-License-Identifier: BSD-3-Clause
"""Unsigned integers in a prefix code (Huffman 1952) of their lengths, for arrays of numbers that are coded at once.

A number of k bits is of class k. Its class has a code word, and its bits below the highest one follow as they are
(as in Elias' gamma code, whose code words are fixed). Code words are canonical: ordered by length, then by class.
"""
import heapq
from typing import List, Sequence, Tuple

import numpy as np

from ...arrays import IntArray, UInt8Array

MAX_LENGTH = 15
"""Maximum length of a code word [bit]."""

CLASSES = 58
"""Number of classes: 0 to 57."""

UNKNOWN = 255
"""In place of a class: the bits are no code word."""

STRIDE = 16
"""Chains of code words are followed in steps of this many words."""


class PrefixCode:
    """A code for classes.

    :param lengths: of the code word of class 0, 1, ... [bit]; 0: the class has none
    :raises ValueError: there is no such code
    """

    def __init__(self, lengths: Sequence[int]) -> None:
        used = sorted((length, class_) for class_, length in enumerate(lengths) if length)
        if not used or len(lengths) > CLASSES or used[-1][0] > MAX_LENGTH:
            raise ValueError('code words of %r bits; there are up to %d of up to %d bits' % (
                list(lengths), CLASSES, MAX_LENGTH))
        self.lengths = np.array(lengths, int)
        """(classes,) int: of the code words [bit]."""
        self.words = np.zeros(len(lengths), np.uint64)
        """(classes,) uint64: the code words."""
        end = 0     # of the words so far, as MAX_LENGTH bits
        for length, class_ in used:
            self.words[class_] = end >> (MAX_LENGTH - length)
            end += 1 << (MAX_LENGTH - length)
        if end > 1 << MAX_LENGTH:
            raise ValueError('code words of %r bits are no prefix code' % list(lengths))
        self._used = used

    def tables(self) -> Tuple[UInt8Array, UInt8Array]:
        """What any MAX_LENGTH bits begin with.

        :return: (2 ** MAX_LENGTH,) uint8 class, or UNKNOWN, and (2 ** MAX_LENGTH,) uint8 length of its word, or 0
        """
        spans = [1 << (MAX_LENGTH - length) for length, _ in self._used]
        rest = (1 << MAX_LENGTH) - sum(spans)
        classes = np.repeat(np.array([class_ for _, class_ in self._used] + [UNKNOWN], np.uint8), spans + [rest])
        lengths = np.repeat(np.array([length for length, _ in self._used] + [0], np.uint8), spans + [rest])
        return classes, lengths

    def write(self) -> bytes:
        """The code as bytes: the number of classes, and 4 bits for the length of each, the first class' above."""
        nibbles = np.zeros(len(self.lengths) + len(self.lengths) % 2, np.uint8)
        nibbles[:len(self.lengths)] = self.lengths
        packed: bytes = (nibbles[::2] << 4 | nibbles[1::2]).tobytes()
        return bytes([len(self.lengths)]) + packed


def read_codes(data: bytes, count: int) -> List[PrefixCode]:
    """The codes that follow each other in some bytes.

    :raises ValueError: there are not exactly `count`
    """
    codes, at = [], 0
    for _ in range(count):
        if at >= len(data):
            break
        stop = at + 1 + (data[at] + 1) // 2
        nibbles = [nibble for byte in data[at + 1:stop] for nibble in (byte >> 4, byte & 15)]
        codes.append(PrefixCode(nibbles[:data[at]]))
        at = stop
    if len(codes) != count or at != len(data):
        raise ValueError('%d bytes are not %d codes' % (len(data), count))
    return codes


def best_code(counts: IntArray) -> PrefixCode:
    """The shortest code for these classes; a little longer where words would have more than MAX_LENGTH bits.

    :param counts: (classes,) int: how often each class occurs; any does
    """
    counts, least = np.trim_zeros(counts, 'b'), 1
    while True:
        lengths = _huffman(np.where(counts, np.maximum(counts, least), 0).tolist())
        if max(lengths) <= MAX_LENGTH:
            return PrefixCode(lengths)
        least *= 2


def _huffman(weights: Sequence[int]) -> List[int]:
    """The length of each class' word; 0 of those of weight 0. A single class has a word of 1 bit."""
    lengths = [0] * len(weights)
    heap: List[Tuple[int, int, List[int]]] = [(weight, i, [i]) for i, weight in enumerate(weights) if weight]
    if len(heap) == 1:
        lengths[heap[0][1]] = 1
    heapq.heapify(heap)
    while len(heap) > 1:
        first, second = heapq.heappop(heap), heapq.heappop(heap)
        for class_ in first[2] + second[2]:
            lengths[class_] += 1
        heapq.heappush(heap, (first[0] + second[0], first[1], first[2] + second[2]))
    return lengths


def follow(code: PrefixCode, rows: UInt8Array, counts: IntArray) -> Tuple[UInt8Array, IntArray]:
    """The classes whose code words follow each other from the first bit of each row on.

    A word's place is known only when all words before it are. Here the length of a word from each bit on is looked up
    for all bits at once, jumps of 2, 4, ... words are composed of these, and chains followed STRIDE words at a time.

    :param rows: (m, k) uint8
    :param counts: (m,) int: number of words of each row, at least 1
    :return: (m, largest count) uint8 classes, UNKNOWN where the bits are no code word; those behind a row's last one
        have no meaning; and (m,) int: where the last word ends [bit]
    """
    classes, lengths = code.tables()
    count, size = len(rows), rows.shape[1]
    padded = np.zeros((count, size + 3), np.int32)
    padded[:, :size] = rows
    triples = padded[:, :-2] << 16 | padded[:, 1:-1] << 8 | padded[:, 2:]
    windows = (triples[:, :, np.newaxis] >> np.arange(24 - MAX_LENGTH, 16 - MAX_LENGTH, -1, np.int32)
               & ((1 << MAX_LENGTH) - 1)).reshape(-1)
    # one byte more than the row: jumps end in its last bit
    width = 8 * (size + 1)
    ends = np.arange(1, count + 1, dtype=np.int32)[:, np.newaxis] * width - 1
    jump = np.arange(count * width, dtype=np.int32) + lengths[windows]
    jump = np.minimum(jump.reshape(count, width), ends).reshape(-1)
    first = jump
    visited = np.arange(count, dtype=np.int32)[:, np.newaxis] * width
    while visited.shape[1] < STRIDE:
        visited = np.concatenate([visited, jump[visited]], axis=1)
        jump = jump[jump]
    steps = [visited]
    for _ in range(-(-int(counts.max()) // STRIDE) - 1):
        steps.append(jump[steps[-1]])
    visited = np.concatenate(steps, axis=1)
    found: UInt8Array = classes[windows[visited]]
    found[visited % width == width - 1] = UNKNOWN
    last = first[visited[np.arange(count), counts - 1]]
    return found[:, :counts.max()], last % width
