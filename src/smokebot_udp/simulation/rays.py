# SPDX-License-Identifier: BSD-3-Clause
"""Ray casting: where rays over the floor plan enter and leave each prism. All sensors use it."""
from typing import Sequence, Tuple

import numpy as np

from ..arrays import Array, BoolArray, Float32Array, FloatArray, IntArray
from .world import CEILING, FLOOR, ROOF, World

NOTHING = -3
"""Surface id of a ray that hits nothing."""


def crossings(world: World, origin: Sequence[float], directions: FloatArray) -> Tuple[Float32Array, Float32Array]:
    """Clip rays by the footprint of each of the P prisms.

    :param origin: (x, y) [m]
    :param directions: (n, 2) float, of any length, which is the unit of the distances returned
    :return: (P, n) enter, (P, n) leave, float32; enter >= leave where a ray misses the prism
    """
    room = (world.offsets - world.normals @ np.asarray(origin, float)).astype(np.float32)[..., np.newaxis]
    east, north = np.transpose(directions).astype(np.float32)
    # a footprint is two pairs of parallel sides: the last two normals are opposite to the first two
    normals = world.normals[:, :2, :, np.newaxis].astype(np.float32)
    # not a matrix product: BLAS would wake a thread on each core for it
    slope = normals[:, :, 0] * east + normals[:, :, 1] * north
    with np.errstate(divide='ignore', invalid='ignore'):
        inverse = 1 / slope
        one, other = room[:, :2] * inverse, -room[:, 2:] * inverse
        return np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)


def in_sight(world: World, enter: Float32Array, leave: Float32Array, nearest: float = 0.0) -> BoolArray:
    """(P, n) bool: where a ray enters a prism farther than `nearest` and not behind a wall that reaches the ceiling."""
    met = (enter < leave) & (enter > nearest)
    walls = world.to_ceiling
    horizon = np.where(met[walls], enter[walls], np.inf).min(axis=0, initial=np.inf)
    return np.asarray(met & (enter <= horizon))


def ranges(world: World, origin: Sequence[float], height: float, azimuths: FloatArray, slopes: FloatArray,
           floor: bool = True) -> Tuple[Float32Array, Array]:
    """Find the nearest surface on each ray of a spinning scanner.

    :param origin: (x, y) of the scanner; height: its z, between floor and ceiling [m]
    :param azimuths: (n,) [rad] in the world; slopes: (m,) rise over run
    :param floor: whether the floor and the ceiling are seen
    :return: (n, m) float32 distances over the floor plan [m], inf where nothing is hit; (n, m) int16 surface ids
    """
    directions = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
    enter, leave = crossings(world, origin, directions)
    nearest = np.full((len(azimuths), len(slopes)), np.inf, np.float32)
    surface = np.full(nearest.shape, NOTHING, np.int16)
    if floor:
        with np.errstate(divide='ignore'):
            level = np.where(slopes < 0, -height / slopes, (CEILING - height) / slopes)
        nearest[:], surface[:] = level, np.where(slopes < 0, FLOOR, ROOF)
        surface[np.isinf(nearest)] = NOTHING
    seen = in_sight(world, enter, leave)
    for prism in np.flatnonzero(seen.any(axis=1)):
        rows = np.flatnonzero(seen[prism])
        _hit(enter[prism, rows], leave[prism, rows], (world.bottom[prism] - height, world.top[prism] - height), slopes,
             rows, prism, nearest, surface)
    return nearest, surface


def _hit(enter: Float32Array, leave: Float32Array, heights: Tuple[float, float], slopes: FloatArray, rows: IntArray,
         prism: int, nearest: Float32Array, surface: Array) -> None:
    """Enter a prism into `nearest` and `surface` wherever it is the nearest so far.

    :param heights: of its underside and its top above the scanner [m]
    """
    bottom, top = heights
    rise = enter[:, np.newaxis] * slopes
    side = (rise >= bottom) & (rise <= top)
    with np.errstate(divide='ignore', invalid='ignore'):
        above, below = top / slopes, bottom / slopes
    # from above onto its top, or from below onto its underside
    flat = np.where(rise > top, above, below)
    on_flat = ~side & (flat > enter[:, np.newaxis]) & (flat < leave[:, np.newaxis])
    distance = np.where(side, enter[:, np.newaxis], np.where(on_flat, flat, np.inf))
    closer = distance < nearest[rows]
    nearest[rows] = np.where(closer, distance, nearest[rows])
    surface[rows] = np.where(closer, prism, surface[rows])
