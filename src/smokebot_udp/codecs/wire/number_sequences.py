# SPDX-License-Identifier: BSD-3-Clause
"""Sequences of numbers, one for each of some chunks, in a prefix code of their lengths (prefix_code.py).

A sequence consists of the length of its code words [byte], the code words of the classes of all numbers, and the bits
below the highest one of each; both begin with a byte. The chunks of one message share a code. All integers, by numpy:
both sides compute the same.
"""
from typing import NamedTuple, Sequence, Tuple

import numpy as np

from ...arrays import Array, BoolArray, IntArray, UInt8Array
from . import bit_fields
from .bit_fields import FieldWriter, bit_lengths
from .prefix_code import CLASSES, MAX_LENGTH, UNKNOWN, PrefixCode, best_code, follow

LENGTH_BITS = 16
"""Size of the length of some code words [bit]."""

MOST_BYTES = -(-(MAX_LENGTH + CLASSES - 2) // 8)
"""What a number takes at most, its code word and the bits below its highest one [byte]."""


class Numbers(NamedTuple):
    """A sequence of numbers for each chunk, and the fields that they take."""
    code: PrefixCode
    words: Array
    """(chunks, rows) uint64: the code words of their classes; 0 where a chunk has no such number."""
    word_bits: IntArray
    """(chunks, rows) int: length of these."""
    rests: Array
    """(chunks, rows) uint64: their bits below the highest one."""
    rest_bits: IntArray
    """(chunks, rows) int: number of these."""
    word_bytes: IntArray
    """(chunks,) int: length of a chunk's code words."""
    rest_bytes: IntArray
    """(chunks,) int: length of a chunk's other bits."""

    @property
    def sizes(self) -> IntArray:
        """(chunks,) int: what the sequence of each takes, with the length of its code words [byte]."""
        return LENGTH_BITS // 8 + self.word_bytes + self.rest_bytes


def numbers_of(values: Array, valid: BoolArray) -> Numbers:
    """The fields that numbers take.

    :param values: (chunks, rows) uint64
    :param valid: (chunks, rows) which of them there are
    """
    classes = np.where(valid, bit_lengths(values), 0)
    code = best_code(np.bincount(classes[valid]))
    word_bits, rest_bits = code.lengths[classes], np.maximum(classes - 1, 0)
    words = code.words[classes]
    word_bits[~valid] = words[~valid] = 0
    rests = values & ((np.uint64(1) << rest_bits.astype(np.uint64)) - np.uint64(1))
    return Numbers(code, words, word_bits, rests, rest_bits, -(-word_bits.sum(axis=1) // 8),
                   -(-rest_bits.sum(axis=1) // 8))


def write(firsts: Array, sequences: Sequence[Numbers], size: int) -> UInt8Array:
    """(chunks, size) uint8: the first bytes of each chunk, and its sequences; 0 behind those.

    :param firsts: (chunks, n) int, n >= 1, below 256
    :param size: at least that of the longest chunk [byte]
    """
    writer = FieldWriter(len(firsts) * size)
    at = np.arange(len(firsts)) * size * 8
    for column in firsts.T:
        writer.write(at, np.full(len(at), 8), column)
        at = at + 8
    for numbers in sequences:
        writer.write(at, np.full(len(at), LENGTH_BITS), numbers.word_bytes)
        at = at + LENGTH_BITS
        writer.write(_starts(numbers.word_bits, at), numbers.word_bits, numbers.words)
        at = at + 8 * numbers.word_bytes
        writer.write(_starts(numbers.rest_bits, at), numbers.rest_bits, numbers.rests)
        at = at + 8 * numbers.rest_bytes
    return writer.data().reshape(-1, size)


def there(counts: IntArray) -> BoolArray:
    """(m, largest count) bool: which numbers there are of sequences of these lengths, (m,) int."""
    valid: BoolArray = np.arange(int(counts.max())) < counts[:, np.newaxis]
    return valid


def _starts(widths: IntArray, at: IntArray) -> IntArray:
    """(chunks, rows) int: where fields begin that follow each other in each chunk from `at` on."""
    starts: IntArray = np.cumsum(widths, axis=1) + at[:, np.newaxis] - widths
    return starts


class SequenceReader:
    """Reads sequences of numbers from chunks, the same of each.

    :param chunks: m arrays (k,) uint8 of any lengths, at least 1
    :param begin: where the first sequence begins, the same of each [byte]
    """

    def __init__(self, chunks: Sequence[UInt8Array], begin: int) -> None:
        self._ends = np.array([len(chunk) for chunk in chunks])
        self.data = np.zeros((len(chunks), max(begin, int(self._ends.max())) + bit_fields.PADDING), np.uint8)
        """(m, largest k and padding) uint8"""
        for row, chunk in zip(self.data, chunks):
            row[:len(chunk)] = chunk
        self.good = self._ends >= begin
        """(m,) bool: whether all that was read of a chunk is possible."""
        self._at = np.where(self.good, begin, 0)

    def numbers(self, code: PrefixCode, counts: IntArray) -> Array:
        """The next sequence: (m, largest count) uint64; 0 behind the last of a chunk, and in broken chunks.

        :param counts: (m,) int: how many numbers each chunk's has, at least 1
        """
        valid = there(counts)
        classes, starts = self._classes(code, counts, valid)
        classes = np.where(valid & self.good[:, np.newaxis], classes, 0).astype(int)
        widths = np.maximum(classes - 1, 0)
        stops = np.cumsum(widths, axis=1)
        self._at = self._checked(starts + -(-stops[:, -1] // 8))
        widths[~self.good] = classes[~self.good] = 0
        firsts = np.arange(len(self.data)) * self.data.shape[1] + starts
        positions = np.where(widths > 0, 8 * firsts[:, np.newaxis] + stops - widths, 0)
        rests = bit_fields.read(self.data.reshape(-1), positions, widths)
        ones = np.uint64(1) << np.maximum(classes - 1, 0).astype(np.uint64)
        return np.where(classes > 0, ones | rests, np.uint64(0))

    def _classes(self, code: PrefixCode, counts: IntArray, valid: BoolArray) -> Tuple[UInt8Array, IntArray]:
        """The classes of the next sequence, and where their code words end [byte]."""
        rows = np.arange(len(self.data))
        begins = self._checked(self._at + 2)
        sizes = self.data[rows, begins - 2].astype(int) << 8 | self.data[rows, begins - 1]
        ends = self._checked(begins + sizes)
        size = int((ends - begins).max())
        places = np.minimum(begins[:, np.newaxis] + np.arange(size), self.data.shape[1] - 1)
        classes, bits = follow(code, self.data[rows[:, np.newaxis], places], counts)
        self.good &= bits <= 8 * (ends - begins)
        self.good &= ~((classes == UNKNOWN) & valid).any(axis=1)
        return classes, ends

    def _checked(self, at: IntArray) -> IntArray:
        """Places in the data; those beyond a chunk's end become 2, and the chunk is broken [byte]."""
        self.good &= at <= self._ends
        checked: IntArray = np.where(self.good, at, 2)
        return checked
