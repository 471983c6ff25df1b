# SPDX-License-Identifier: BSD-3-Clause
"""Arrays that cover a rectangle of the lattice, cell by cell or in blocks."""
import numpy as np

from ...arrays import Array
from ...codecs.tiles.rectangle import Rectangle


def moved(values: Array, old: Rectangle, new: Rectangle, default: float) -> Array:
    """What an array of one rectangle is in another one.

    :param values: (old.height, old.width)
    :param default: of what was outside
    :return: (new.height, new.width), of the same dtype
    """
    result = np.full((new.height, new.width), default, values.dtype)
    common = old.within(new)
    result[new.slices(common)] = values[old.slices(common)]
    return result


def renumbered(values: Array, area: Rectangle, columns: int, rows: int, shift: int) -> Array:
    """The blocks of a rectangle whose cells are numbered by as many more: each is the one around its middle before.

    :param values: (height, width): the blocks of 2^shift cells a side of `area`
    :return: (height, width): those of area.moved(columns, rows), of the same dtype
    """
    before, after = area.blocks(shift), area.moved(columns, rows).blocks(shift)
    places = []
    for first, count, step, old_first, old_count in (
            (after.row, after.height, rows, before.row, before.height),
            (after.column, after.width, columns, before.column, before.width)):
        middles = (np.arange(first, first + count) << shift) + (1 << shift >> 1) - step
        places.append(np.clip((middles >> shift) - old_first, 0, old_count - 1))
    found: Array = values[np.ix_(*places)]
    return found
