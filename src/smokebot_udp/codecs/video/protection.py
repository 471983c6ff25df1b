# SPDX-License-Identifier: BSD-3-Clause
"""An erasure code over the slices of an image: any `count` of its pieces give back all slices.

The code is systematic: the first pieces are the slices, and those that arrive are of use also where too few do. A
source piece is the length of a slice, in two bytes, and the slice, filled with zeros up to the longest one. On the air
it is the slice alone: its datagram has a length of its own. Parity pieces are as long as the longest source piece.
"""
from typing import Dict, List, Mapping, Sequence

import numpy as np

from ...arrays import UInt8Array
from ..layered import erasure

LENGTH_BYTES = 2
"""A parity piece is this much longer than the longest slice [byte]."""

MAX_PIECES = 255
"""Slices and parity pieces of an image, at most."""

MAX_PIECE = 65535
"""Length of a slice, at most [byte]."""


def protect(slices: Sequence[bytes], parities: int) -> List[bytes]:
    """The parity pieces of an image.

    :param slices: its slices
    :param parities: number of parity pieces
    :return: all of one length: that of the longest slice, and LENGTH_BYTES
    :raises ValueError: there are no slices, more than MAX_PIECES in all, or a slice is longer than MAX_PIECE
    :raises ImportError: there is no numba
    """
    if not slices or parities < 0 or len(slices) + parities > MAX_PIECES or max(map(len, slices)) > MAX_PIECE:
        raise ValueError('%d slices with %d parity pieces are more than %d pieces, or too long' % (
            len(slices), parities, MAX_PIECES))
    if not parities:
        return []
    source = _source(dict(enumerate(slices)), len(slices), LENGTH_BYTES + max(map(len, slices)))
    return [piece.tobytes() for piece in erasure.extend(source, len(slices) + parities)]


def restore(received: Mapping[int, bytes], count: int) -> Dict[int, bytes]:
    """The slices that can be had: {index: slice}, all `count` where as many pieces were received.

    :param received: {index: piece}: of slices below `count`, of parity pieces from there on
    :param count: slices of the image
    :raises ValueError: indexes are out of range, or pieces contradict each other; whoever sent them is wrong
    :raises ImportError: there is no numba
    """
    if not 0 < count <= MAX_PIECES or not all(0 <= index < MAX_PIECES for index in received):
        raise ValueError('there are %d slices and pieces %s, must be up to %d' % (count, sorted(received), MAX_PIECES))
    slices = {index: piece for index, piece in received.items() if index < count}
    if len(slices) == count or len(received) < count:
        return slices
    parity = {index: piece for index, piece in received.items() if index >= count}
    sizes, longest = {len(piece) for piece in parity.values()}, max(map(len, slices.values()), default=0)
    size = max(sizes)
    if len(sizes) > 1 or not LENGTH_BYTES + longest <= size <= LENGTH_BYTES + MAX_PIECE:
        raise ValueError('parity pieces of %s bytes do not belong to slices of up to %d bytes' % (
            sorted(sizes), longest))
    used = sorted(parity)[:count - len(slices)]
    rows = _source(slices, count, size)
    have = sorted(slices)
    pieces = np.vstack([rows[have], *(np.frombuffer(parity[index], np.uint8) for index in used)])
    source = erasure.recover(np.array(have + used), pieces)
    return {index: _slice(row) for index, row in enumerate(source)}


def _source(slices: Mapping[int, bytes], count: int, size: int) -> UInt8Array:
    """(count, size) uint8: the source pieces; zeros where there is no slice."""
    rows = np.zeros((count, size), np.uint8)
    for index, data in slices.items():
        rows[index, :LENGTH_BYTES] = divmod(len(data), 256)
        rows[index, LENGTH_BYTES:LENGTH_BYTES + len(data)] = np.frombuffer(data, np.uint8)
    return rows


def _slice(row: UInt8Array) -> bytes:
    """The slice of a source piece.

    :raises ValueError: its length is beyond the piece
    """
    length = int(row[0]) * 256 + int(row[1])
    if LENGTH_BYTES + length > len(row):
        raise ValueError('a slice of %d bytes is not in a piece of %d' % (length, len(row)))
    found: bytes = row[LENGTH_BYTES:LENGTH_BYTES + length].tobytes()
    return found
