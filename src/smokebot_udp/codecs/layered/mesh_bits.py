# SPDX-License-Identifier: BSD-3-Clause
"""Displacements of a mesh's nodes to bits and back, without loss.

Corners come first, each as the difference to what the corners before it predict: equal, or affine for the last one.
Then come the nodes that each next level adds, as the difference to the mean of the nodes between which they are. The
differences of a level and a direction are in a Rice code (Rice 1979) of the parameter that suits them, which precedes
them in 4 bits.
"""
import functools
from typing import List, Tuple

import numpy as np

from ...arrays import IntArray
from ..wire.bit_fields import unzigzag, zigzag
from ..wire.bits import BitReader

PARAMETER_BITS = 4
MAX_PREFIX = 24
"""Maximum length of the prefix of a number [bit]. A longer one is refused."""
LIMIT = 1 << 14
"""Displacements are from -LIMIT to LIMIT."""


class _Reader(BitReader):

    def rice(self, parameter: int) -> int:
        """A number in a Rice code.

        :raises ValueError: there are fewer bits, or its prefix is longer than MAX_PREFIX
        """
        prefix = 0
        while self.flag():
            prefix += 1
            if prefix > MAX_PREFIX:
                raise ValueError('a displacement is too long')
        return prefix << parameter | self.bits(parameter)


def prolonged(nodes: IntArray) -> IntArray:
    """The mesh of the next level that displaces alike, rounded down: (n, n, 2) int to (2 n - 1, 2 n - 1, 2) int."""
    finer = np.empty((2 * len(nodes) - 1, 2 * len(nodes) - 1, 2), np.int64)
    finer[::2, ::2] = nodes
    finer[1::2, ::2] = (nodes[:-1] + nodes[1:]) >> 1
    finer[:, 1::2] = (finer[:, :-1:2] + finer[:, 2::2]) >> 1
    return finer


@functools.lru_cache(maxsize=8)
def _added(size: int) -> Tuple[IntArray, IntArray]:
    """Rows and columns of the nodes of a mesh of size x size that the next coarser one has not."""
    rows, columns = np.indices((size, size))
    added = ((rows | columns) & 1).astype(bool)
    return rows[added], columns[added]


def _rice(numbers: List[int]) -> str:
    """Bits of numbers: the parameter that suits them best, and their code."""
    k = (max(numbers) // (MAX_PREFIX + 1)).bit_length()     # the least one without too long prefixes
    while k + 1 < 1 << PARAMETER_BITS and _length(numbers, k + 1) < _length(numbers, k):
        k += 1
    code = ['1' * (number >> k) + '0' + (f'{number & ((1 << k) - 1):0{k}b}' if k else '') for number in numbers]
    return f'{k:0{PARAMETER_BITS}b}' + ''.join(code)


def _length(numbers: List[int], k: int) -> int:
    """The length of the code of numbers with the parameter k, but for one bit for each number [bit]. It is a convex
    function of k."""
    return sum([number >> k for number in numbers]) + k * len(numbers)


def write(nodes: IntArray) -> bytes:
    """The bits of a mesh's displacements, filled up with zeros to bytes.

    :param nodes: (n, n, 2) int, n = 2^level + 1, from -LIMIT to LIMIT
    """
    nodes = nodes.astype(np.int64)
    last = len(nodes) - 1
    corners = nodes[::last, ::last]
    first = corners[0, 0]
    bits = _fields(np.stack([first, corners[0, 1] - first, corners[1, 0] - first,
                             corners[1, 1] - corners[0, 1] - corners[1, 0] + first]))
    coarse = corners
    while len(coarse) < len(nodes):
        step = last // (2 * (len(coarse) - 1))
        fine, where = nodes[::step, ::step], _added(2 * len(coarse) - 1)
        bits += _fields((fine - prolonged(coarse))[where])
        coarse = fine
    return int(bits + '0' * (-len(bits) % 8), 2).to_bytes(-(-len(bits) // 8), 'big')


def _fields(differences: IntArray) -> str:
    """(m, 2) int: the bits of one level, down and then right."""
    return ''.join(_rice(zigzag(column).tolist()) for column in differences.T)


def read(data: bytes, level: int) -> IntArray:
    """The mesh that `write` wrote: (2^level + 1, 2^level + 1, 2) int.

    :raises ValueError: the bytes end too early, or a displacement is not from -LIMIT to LIMIT
    """
    reader = _Reader(data)
    corners = _differences(reader, 4)
    corners[1:3] += corners[0]
    corners[3] += corners[1] + corners[2] - corners[0]
    nodes = corners.reshape(2, 2, 2)
    for _ in range(level):
        nodes = prolonged(nodes)
        where = _added(len(nodes))
        nodes[where] += _differences(reader, len(where[0]))
    if abs(nodes).max() > LIMIT:
        raise ValueError('a displacement of %d' % abs(nodes).max())
    return nodes


def _differences(reader: _Reader, count: int) -> IntArray:
    """(count, 2) int: of one level."""
    columns = []
    for _ in range(2):
        parameter = reader.bits(PARAMETER_BITS)
        columns.append([reader.rice(parameter) for _ in range(count)])
    return unzigzag(np.array(columns, np.uint64).T)
