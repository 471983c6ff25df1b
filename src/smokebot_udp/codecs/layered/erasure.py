# SPDX-License-Identifier: BSD-3-Clause
"""A systematic Reed-Solomon code from a Cauchy matrix: any t of n pieces give back the t pieces of the source.

GF(256) has 256 elements; piece i belongs to element i. The first t pieces are the source itself. Parity piece i is the
sum of source pieces j, each times 1 / (i + j). Every square part of a Cauchy matrix has an inverse, in closed form, so
any t pieces do (J. Bloemer et al., An XOR-Based Erasure-Resilient Coding Scheme, ICSI TR-95-048, 1995).
"""
import numpy as np

from ...arrays import IntArray, UInt8Array
from .field import LOGARITHMS, POWERS

MAX_PIECES = 256
"""Pieces of one code: elements of the field."""

WORD = 8
"""Bytes that are multiplied at a time."""


def extend(source: UInt8Array, count: int) -> UInt8Array:
    """The parity pieces that extend a source to `count` pieces.

    :param source: (t, s) uint8
    :return: (count - t, s) uint8: pieces t..count - 1
    :raises ValueError: count is below t or above MAX_PIECES
    """
    threshold = len(source)
    if not 0 < threshold <= count <= MAX_PIECES:
        raise ValueError('%d pieces of %d to %d' % (count, threshold, MAX_PIECES))
    return product(_cauchy(np.arange(threshold, count), np.arange(threshold)), source)


def recover(indexes: IntArray, pieces: UInt8Array) -> UInt8Array:
    """The source of as many pieces as it has.

    :param indexes: (t,) int, different and below MAX_PIECES
    :param pieces: (t, s) uint8
    :return: (t, s) uint8
    :raises ValueError: indexes are not t different ones
    """
    threshold = len(indexes)
    ordered = np.sort(indexes)
    if not 0 < threshold == len(pieces) or ordered[0] < 0 or ordered[-1] >= MAX_PIECES or not np.diff(ordered).all():
        raise ValueError('%d pieces with %d indexes: %s' % (len(pieces), threshold, indexes))
    of_source = indexes < threshold
    source = np.zeros((threshold, pieces.shape[1]), np.uint8)
    source[indexes[of_source]] = pieces[of_source]
    have, parity = indexes[of_source], indexes[~of_source]
    if len(parity):
        is_lost = np.ones(threshold, bool)
        is_lost[have] = False
        lost = np.flatnonzero(is_lost)
        rest = pieces[~of_source] ^ product(_cauchy(parity, have), source[have])
        source[lost] = product(_cauchy_inverse(parity, lost), rest)
    return source


def product(matrix: UInt8Array, rows: UInt8Array) -> UInt8Array:
    """The product of two matrices over GF(256).

    :param matrix: (r, t) uint8
    :param rows: (t, s) uint8
    :return: (r, s) uint8
    :raises ImportError: there is no numba
    """
    from .products import add_products  # compiled: it takes 1 s and 100 MB to import
    words = -(-rows.shape[1] // WORD)
    packed, result = np.zeros((len(rows), words), np.uint64), np.zeros((len(matrix), words), np.uint64)
    packed.view(np.uint8)[:, :rows.shape[1]] = rows
    add_products(np.ascontiguousarray(matrix), packed, result)
    product_bytes: UInt8Array = result.view(np.uint8)[:, :rows.shape[1]]
    return product_bytes


def _cauchy(x: IntArray, y: IntArray) -> UInt8Array:
    """(len(x), len(y)) uint8: 1 / (x + y); no x equals a y."""
    elements: UInt8Array = POWERS[255 - LOGARITHMS[x[:, np.newaxis] ^ y]]
    return elements


def _cauchy_inverse(x: IntArray, y: IntArray) -> UInt8Array:
    """(n, n) uint8: the inverse of _cauchy(x, y), for as many x as y (D. Knuth, TAOCP 1, 1.2.3, exercise 41).

    Its element [j, i] is the product over all k of (x_k + y_j) (x_i + y_k), divided by (x_i + y_j) and by the products
    over all others of (x_i + x_k) and (y_j + y_k).
    """
    both = LOGARITHMS[x[:, np.newaxis] ^ y]
    of_x, of_y = both.sum(axis=1) - _products_of_differences(x), both.sum(axis=0) - _products_of_differences(y)
    elements: UInt8Array = POWERS[(of_x + of_y[:, np.newaxis] - both.T) % 255]
    return elements


def _products_of_differences(x: IntArray) -> IntArray:
    """(n,) int: for each element the logarithm of the product of its differences from the others."""
    total: IntArray = LOGARITHMS[x[:, np.newaxis] ^ x].sum(axis=1)    # LOGARITHMS[0] is 0
    return total
