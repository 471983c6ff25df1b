# SPDX-License-Identifier: BSD-3-Clause
"""Splits an image or a map into interleaved subimages, and merges them again (D6.3, section 4.1).

Table 2(a), ``0 2 / 3 1``, assigns each pixel of a 2 by 2 block to one of four subimages. Applied recursively, depth
times, it numbers the p * p places of a p by p block, p = 2^depth: Table 3. Subimage i consists of the pixels at place i
of all blocks, so each subimage shows the whole image. The first 4^k subimages, for any k, form a regular grid: they are
in order from coarse to fine.
"""
import functools
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from ...arrays import Array, BoolArray, IntArray

TABLE_2A = np.array([[0, 2], [3, 1]])
MAX_DEPTH = 8
MAX_SIDE = 4096
"""Maximum number of rows, and of columns, of an image or a map."""

CACHED_ORDERS = 16
"""Orders are cached for this many layouts: segments, forged ones too, name any layout, and one takes up to 1 MB."""


@functools.lru_cache(maxsize=None)
def table(depth: int) -> IntArray:
    """Table 3 for any depth: the subimage of each place of a block.

    :return: (p, p) int array, [row, column] -> index, read-only
    :raises ValueError: depth is not in 0..MAX_DEPTH
    """
    if not 0 <= depth <= MAX_DEPTH:
        raise ValueError('depth is %r, must be from 0 to %d' % (depth, MAX_DEPTH))
    result = np.zeros((1, 1), int)
    for _ in range(depth):
        p = len(result)
        # the finest split comes last and has the largest weight: D6.3's Table 3(a) from 2(a)
        result = np.kron(np.ones_like(result), TABLE_2A) * p * p + np.kron(result, np.ones_like(TABLE_2A))
    result.setflags(write=False)
    return result


@dataclass(frozen=True)
class Interleave:
    """The layout of the subimages of a height by width grid.

    All subimages are ceil(height / p) by ceil(width / p). Where the grid is not a multiple of p, the last row or column
    is repeated. If the grid is smaller than a block, places outside the grid have no subimage. Arrays of subimages are
    in the order of their indexes, `order`.

    :raises ValueError: a side is not in 1..MAX_SIDE, or depth not in 0..MAX_DEPTH
    """
    height: int
    width: int
    depth: int

    def __post_init__(self) -> None:
        for name, side in (('height', self.height), ('width', self.width)):
            if not 1 <= side <= MAX_SIDE:
                raise ValueError('%s is %r, must be from 1 to %d' % (name, side, MAX_SIDE))
        if not 0 <= self.depth <= MAX_DEPTH:
            raise ValueError('depth is %r, must be from 0 to %d' % (self.depth, MAX_DEPTH))

    @property
    def p(self) -> int:
        """Side of a block, and distance between neighbouring pixels of a subimage [pixel]."""
        return 1 << self.depth

    @property
    def shape(self) -> Tuple[int, int]:
        """(rows, columns) of each subimage."""
        return -(-self.height // self.p), -(-self.width // self.p)

    @property
    def order(self) -> IntArray:
        """(n,) int: the indexes of the existing subimages, ascending. Read-only."""
        return _order(min(self.height, self.p), min(self.width, self.p), self.depth)

    @property
    def positions(self) -> IntArray:
        """(p * p,) int: the position of each index in `order`; -1 if it has no subimage. Read-only."""
        return _positions(min(self.height, self.p), min(self.width, self.p), self.depth)

    def __len__(self) -> int:
        """The number of subimages, n."""
        return min(self.height, self.p) * min(self.width, self.p)

    def split(self, grid: Array) -> Array:
        """Split a grid into subimages.

        :param grid: (height, width, ...) array
        :return: (n, rows, columns, ...) array of the same dtype, in `order`
        :raises ValueError: the grid has another size
        """
        if grid.shape[:2] != (self.height, self.width):
            raise ValueError('the grid is %s, not %s' % (grid.shape[:2], (self.height, self.width)))
        (rows, columns), p, more = self.shape, self.p, grid.shape[2:]
        below, beside = rows * p - self.height, columns * p - self.width
        if below or beside:
            grid = np.pad(grid, ((0, below), (0, beside)) + ((0, 0),) * len(more), mode='edge')
        blocks = grid.reshape((rows, p, columns, p) + more)
        places = np.ascontiguousarray(np.moveaxis(blocks, (1, 3), (0, 1))).reshape((p * p, rows, columns) + more)
        subimages: Array = places[_places(self.depth)[self.order]]
        return subimages

    def merge(self, subimages: Array) -> Array:
        """The inverse of split.

        :param subimages: (n, rows, columns, ...) array, in `order`
        :return: (height, width, ...) array of the same dtype, C-contiguous
        """
        (rows, columns), p, more = self.shape, self.p, subimages.shape[3:]
        grid = np.empty((rows, p, columns, p) + more, subimages.dtype)
        # places outside the grid get any subimage: they are cut off below
        np.moveaxis(grid, (1, 3), (0, 1))[...] = subimages[self.positions[table(self.depth)]]
        return np.ascontiguousarray(grid.reshape((rows * p, columns * p) + more)[:self.height, :self.width])

    def pixel_mask(self, have: BoolArray) -> BoolArray:
        """The pixels of some subimages.

        :param have: (n,) bool, which subimages, in `order`
        :return: (height, width) bool
        """
        positions = self.positions[table(self.depth)]
        block = (positions >= 0) & have[positions]
        rows, columns = self.shape
        row_of_blocks = np.tile(block, (1, columns))[:, :self.width]
        mask = np.broadcast_to(row_of_blocks, (rows, self.p, self.width))
        return mask.reshape(rows * self.p, self.width)[:self.height]


FINER_SEGMENTS = 0.9
"""The next depth is used if it needs at most this ratio of the segments: smaller subimages fill segments better."""


def fit(height: int, width: int, cell_size: int, room: int) -> Tuple[Interleave, int]:
    """A layout whose subimages fit in segments and use most of their size.

    That is the coarsest one that fits, or the next one if that saves segments (FINER_SEGMENTS).

    :param cell_size: size of a pixel [byte]
    :param room: size of a segment's pixels, at most [byte]
    :return: the layout, and the number of subimages in a segment
    :raises ValueError: the size is out of limits, or no depth fits
    """
    layouts = (Interleave(height, width, depth) for depth in range(MAX_DEPTH + 1))
    fitting = [(layout, per_segment) for layout, per_segment in (
        (layout, min(room // (layout.shape[0] * layout.shape[1] * cell_size), len(layout), 255))
        for layout in layouts) if per_segment]
    if not fitting:
        raise ValueError('%d x %d pixels of %d bytes do not fit in segments of %d bytes' % (
            width, height, cell_size, room))
    # segments that the two coarsest need
    segments = [-(-len(layout) // per_segment) for layout, per_segment in fitting[:2]]
    return fitting[1] if len(segments) > 1 and segments[1] <= FINER_SEGMENTS * segments[0] else fitting[0]


@functools.lru_cache(maxsize=None)
def _places(depth: int) -> IntArray:
    """(p * p,) int: the place in a block, row by row, of each index."""
    return np.argsort(table(depth), axis=None)


@functools.lru_cache(maxsize=CACHED_ORDERS)
def _order(rows: int, columns: int, depth: int) -> IntArray:
    order = np.sort(table(depth)[:rows, :columns], axis=None)
    order.setflags(write=False)
    return order


@functools.lru_cache(maxsize=CACHED_ORDERS)
def _positions(rows: int, columns: int, depth: int) -> IntArray:
    positions = np.full(4 ** depth, -1)
    positions[_order(rows, columns, depth)] = np.arange(rows * columns)
    positions.setflags(write=False)
    return positions
