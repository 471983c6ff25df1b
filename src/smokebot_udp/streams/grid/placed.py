# SPDX-License-Identifier: BSD-3-Clause
"""Arrays that cover a rectangle of the lattice."""
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
