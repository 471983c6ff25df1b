# SPDX-License-Identifier: BSD-3-Clause
"""Cuts a grid of pixels into interleaved subimages, and puts them together again (D6.3, section 4.1).

Table 2(a), ``0 2 / 3 1``, says which subimage each pixel of a 2 by 2 block belongs to. Applied to the blocks
of blocks too, depth times in all, it numbers the p * p places of a p by p block, p = 2^depth: Table 3.
Subimage i takes the pixel at its place from every block, so that each shows the whole picture, and the first
4^k of them, for any k, are a regular grid: coarse first.
"""
import functools
from dataclasses import dataclass

import numpy as np

TABLE_2A = np.array([[0, 2], [3, 1]])
MAX_DEPTH = 8
MAX_SIDE = 4096
"""Pictures and maps have at most so many rows, and so many columns."""

CUTS_KEPT = 16
"""Of so many cuts the order is kept: they are made for the sizes segments name, forged ones too, and take up to
1 MB each."""


@functools.lru_cache(maxsize=None)
def table(depth):
    """Table 3 for any depth: the subimage of each place of a block.

    :return: (p, p) int array, [row, column] -> index, read-only
    :raises ValueError: where depth is not in 0..MAX_DEPTH
    """
    if not 0 <= depth <= MAX_DEPTH:
        raise ValueError('depth is %r, must be from 0 to %d' % (depth, MAX_DEPTH))
    result = np.zeros((1, 1), int)
    for _ in range(depth):
        p = len(result)
        # the finest split comes last, and counts most: D6.3's Table 3(a) from 2(a)
        result = np.kron(np.ones_like(result), TABLE_2A) * p * p + np.kron(result, np.ones_like(TABLE_2A))
    result.setflags(write=False)
    return result


@dataclass(frozen=True)
class Interleave:
    """How a grid of height by width is cut with a depth.

    Subimages are all ceil(height / p) by ceil(width / p): those that would end earlier repeat the grid's last
    row or column. Where the grid is smaller than a block, the places outside it have no subimage. Subimages
    are held in the order of their indexes, `order`.
    """
    height: int
    width: int
    depth: int

    def __post_init__(self):
        for name, side in (('height', self.height), ('width', self.width)):
            if not 1 <= side <= MAX_SIDE:
                raise ValueError('%s is %r, must be from 1 to %d' % (name, side, MAX_SIDE))
        if not 0 <= self.depth <= MAX_DEPTH:
            raise ValueError('depth is %r, must be from 0 to %d' % (self.depth, MAX_DEPTH))

    @property
    def p(self):
        """The side of a block, and the step between a subimage's pixels."""
        return 1 << self.depth

    @property
    def shape(self):
        """(rows, columns) of each subimage."""
        return -(-self.height // self.p), -(-self.width // self.p)

    @property
    def order(self):
        """(n,) int: the indexes of the subimages there are, ascending. Read-only."""
        return _order(min(self.height, self.p), min(self.width, self.p), self.depth)

    @property
    def positions(self):
        """(p * p,) int: where in `order` each index stands; -1: it has no subimage. Read-only."""
        return _positions(min(self.height, self.p), min(self.width, self.p), self.depth)

    def __len__(self):
        """The number of subimages, n."""
        return min(self.height, self.p) * min(self.width, self.p)

    def split(self, grid):
        """Cut a grid.

        :param grid: (height, width, ...) array
        :return: (n, rows, columns, ...) array of the same dtype, in `order`
        :raises ValueError: where the grid is of another size
        """
        if grid.shape[:2] != (self.height, self.width):
            raise ValueError('the grid is %s, not %s' % (grid.shape[:2], (self.height, self.width)))
        (rows, columns), p, more = self.shape, self.p, grid.shape[2:]
        below, beside = rows * p - self.height, columns * p - self.width
        if below or beside:
            grid = np.pad(grid, ((0, below), (0, beside)) + ((0, 0),) * len(more), mode='edge')
        blocks = grid.reshape((rows, p, columns, p) + more)
        places = np.ascontiguousarray(np.moveaxis(blocks, (1, 3), (0, 1))).reshape((p * p, rows, columns) + more)
        return places[_places(self.depth)[self.order]]

    def merge(self, subimages):
        """The inverse of split.

        :param subimages: (n, rows, columns, ...) array, in `order`
        :return: (height, width, ...) array of the same dtype, C-contiguous
        """
        (rows, columns), p, more = self.shape, self.p, subimages.shape[3:]
        grid = np.empty((rows, p, columns, p) + more, subimages.dtype)
        # places outside the grid get any subimage: they are cut off below
        np.moveaxis(grid, (1, 3), (0, 1))[...] = subimages[self.positions[table(self.depth)]]
        return np.ascontiguousarray(grid.reshape((rows * p, columns * p) + more)[:self.height, :self.width])


WORTH_DEEPER = 0.9
"""One depth more is taken where it needs at most so many of the segments: smaller subimages fill them better."""


def fit(height, width, cell_size, room):
    """A cut whose subimages fit in `room` bytes and fill it well, and how many of them one segment then holds.

    The coarsest that fits, or the next one where that saves segments (WORTH_DEEPER).

    :param cell_size: bytes of a pixel
    :return: (Interleave, subimages a segment)
    :raises ValueError: where the size is out of limits, or no depth fits
    """
    cuts = (Interleave(height, width, depth) for depth in range(MAX_DEPTH + 1))
    fitting = [(cut, per_segment) for cut, per_segment in (
        (cut, min(room // (cut.shape[0] * cut.shape[1] * cell_size), len(cut), 255)) for cut in cuts) if per_segment]
    if not fitting:
        raise ValueError('%d x %d pixels of %d bytes do not fit in segments of %d bytes' % (
            width, height, cell_size, room))
    coarsest, *finer = fitting
    if finer and _segments(*finer[0]) <= WORTH_DEEPER * _segments(*coarsest):
        return finer[0]
    return coarsest


def _segments(cut, per_segment):
    return -(-len(cut) // per_segment)


@functools.lru_cache(maxsize=None)
def _places(depth):
    """(p * p,) int: the place in a block, row by row, of each index."""
    return np.argsort(table(depth), axis=None)


@functools.lru_cache(maxsize=CUTS_KEPT)
def _order(rows, columns, depth):
    order = np.sort(table(depth)[:rows, :columns], axis=None)
    order.setflags(write=False)
    return order


@functools.lru_cache(maxsize=CUTS_KEPT)
def _positions(rows, columns, depth):
    positions = np.full(4 ** depth, -1)
    positions[_order(rows, columns, depth)] = np.arange(rows * columns)
    positions.setflags(write=False)
    return positions
