# SPDX-License-Identifier: BSD-3-Clause
"""The chunks of a sorted cloud, as far as they were received (see sorted_cloud.py).

Chunks come from the network: invalid ones are left out, whatever they contain, and memory and time are bounded by
the bytes that were received.
"""
from typing import Dict, Iterator, List, Optional, Tuple

import numpy as np

from ...arrays import Array, BoolArray, Float32Array, IntArray, UInt8Array
from .bit_fields import unzigzag
from .cloud import MAX_POINTS, PointFormat, sending_order
from .number_sequences import LENGTH_BITS, MOST_BYTES, SequenceReader, there
from .parts import ReceivedParts
from .prefix_code import read_codes
from .sorted_cloud import HASHED, MAX_KEY, can_sort, spread
from .z_order import offsets_of

BLOCK = 100000
"""Chunks are decoded at a time that have this size together, if all were as long as the longest of them; or one that is
longer. Decoding takes some 200 bytes for each byte of that [byte]."""


class SortedParts(ReceivedParts):
    """The chunks of one cloud, as far as they were received.

    :param points: number of points of the whole cloud
    :param chunks: number of chunks
    :param codes: what is needed to read any of them
    :raises ValueError: these contradict each other or exceed a limit
    """

    def __init__(self, points: int, chunks: int, point_format: PointFormat, codes: bytes) -> None:
        if not (1 <= chunks <= points <= MAX_POINTS):
            raise ValueError('%d points in %d chunks; there are up to %d' % (points, chunks, MAX_POINTS))
        if not can_sort(point_format):
            raise ValueError('step is %r, bits are %r; sorted points have up to %d bits' % (
                point_format.step, point_format.bits, MAX_KEY))
        super().__init__(chunks, sending_order(chunks))
        self._codes = read_codes(codes, 3 if point_format.has_intensity else 2)
        self._points, self._format = points, point_format
        self._chunks: Dict[int, UInt8Array] = {}
        self.broken = 0
        """How many chunks `merge` has found to be broken. They do not count as received any more."""

    def add(self, indexes: IntArray, payloads: UInt8Array) -> BoolArray:
        """Add chunks of the same length.

        :param indexes: (m,) int, their numbers
        :param payloads: (m, k) uint8
        :return: (m,) bool: those that fit the cloud; the others were dropped
        """
        good: BoolArray = indexes < len(self.have)
        size, sequences = payloads.shape[1], len(self._codes)
        # each number takes a bit at least
        good &= self._counts(indexes) * sequences <= 8 * size
        # the longest chunk has as many points as the first one; shorter ones may end with zeros
        longest = int(self._counts(np.zeros(1, int))[0])
        good &= size <= 1 + sequences * (LENGTH_BITS // 8 + MOST_BYTES * longest)
        for index, payload in zip(indexes[good].tolist(), payloads[good]):
            self._chunks[index] = payload.copy()     # not a view, which would keep the whole batch
        self.have[indexes[good]] = True
        return good

    def _counts(self, indexes: IntArray) -> IntArray:
        """(m,) int: how many points these chunks have."""
        counts: IntArray = (self._points - 1 - indexes) // len(self.have) + 1
        return counts

    def merge(self) -> Tuple[Array, Optional[Float32Array]]:
        """The points received, without those of broken chunks and forged ones that are not finite.

        :return: (n, 3) points [m], and (n,) float32 intensities or None
        """
        blocks = [self._decoded(np.array(block)) for block in self._blocks()]
        nothing = self._format.points(np.zeros((0, 3), int)), np.zeros(0, np.float32)
        points, intensity = (np.concatenate(parts) for parts in zip(nothing, *blocks))
        return points, intensity if self._format.has_intensity else None

    def _blocks(self) -> Iterator[List[int]]:
        """The numbers of the chunks that were received, those that are decoded at a time."""
        block: List[int] = []
        longest = 0
        for index in np.flatnonzero(self.have).tolist():
            size = len(self._chunks[index])
            longest = max(longest, size)
            if block and (len(block) + 1) * longest > BLOCK:
                yield block
                block, longest = [], size
            block.append(index)
        if block:
            yield block

    def _decoded(self, indexes: IntArray) -> Tuple[Array, Float32Array]:
        """The points of some chunks, (n, 3), and their intensities, (n,): minima where there are none.

        :param indexes: (m,) int, m >= 1, received
        """
        counts = self._counts(indexes)
        reader = SequenceReader([self._chunks[index] for index in indexes.tolist()], 1)
        centres = reader.data[:, 0].astype(int)[:, np.newaxis]
        numbers = [reader.numbers(code, counts) for code in self._codes]
        hashed = min(HASHED, sum(self._format.bits))
        higher = np.cumsum(numbers[0], axis=1)
        reader.good &= (numbers[1] < 1 << hashed).all(axis=1)
        # each gap has less than 57 bits: a sum beyond 64 bits is smaller than the one before
        reader.good &= (higher[:, 1:] >= higher[:, :-1]).all(axis=1)
        reader.good &= higher[:, -1] <= np.uint64((1 << sum(self._format.bits) >> hashed) - 1)
        own = (unzigzag(numbers[1]) + centres).astype(np.uint64) - spread(higher, hashed)
        keys = higher << np.uint64(hashed) | own & np.uint64((1 << hashed) - 1)
        changes = numbers[2] if len(numbers) > 2 else np.zeros_like(keys)
        levels = np.cumsum(unzigzag(changes), axis=1) & 255
        reader.good &= (changes < 256).all(axis=1)
        self.have[indexes[~reader.good]] = False
        self.broken += int(np.count_nonzero(~reader.good))
        kept = there(counts) & reader.good[:, np.newaxis]
        points = self._format.points(offsets_of(keys[kept], self._format.bits))
        finite = np.isfinite(points).all(axis=1)
        return points[finite], self._format.intensities(levels[kept][finite])
