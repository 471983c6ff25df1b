# SPDX-License-Identifier: BSD-3-Clause
"""Where rays over the floor plan enter and leave each prism; all sensors see through this."""
import numpy as np

from .world import CEILING, FLOOR, ROOF

NOTHING = -3
"""Surface id where a ray meets nothing."""


def crossings(world, origin, directions):
    """Clip rays by every prism's footprint.

    :param origin: (x, y) [m]
    :param directions: (n, 2) float, of any length; distances are in units of it
    :return: (P, n) enter, (P, n) leave, float32; enter < leave is false where a ray passes by
    """
    room = (world.offsets - world.normals @ np.asarray(origin, float)).astype(np.float32)[..., np.newaxis]
    east, north = np.transpose(directions).astype(np.float32)
    # a footprint is two pairs of parallel sides: the first two normals have their opposites in the last two
    normals = world.normals[:, :2, :, np.newaxis].astype(np.float32)
    # no matrix product: BLAS would wake a thread on each core for it
    slope = normals[:, :, 0] * east + normals[:, :, 1] * north
    with np.errstate(divide='ignore', invalid='ignore'):
        inverse = 1 / slope
        one, other = room[:, :2] * inverse, -room[:, 2:] * inverse
        return np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)


def in_sight(world, enter, leave, nearest=0.0):
    """(P, n) bool: where a ray enters a prism, farther than `nearest` and before any wall that nobody sees over."""
    met = (enter < leave) & (enter > nearest)
    walls = world.to_ceiling
    horizon = np.where(met[walls], enter[walls], np.inf).min(axis=0, initial=np.inf)
    return met & (enter <= horizon)


def ranges(world, origin, height, azimuths, slopes, floor=True):
    """The nearest surface of each ray of a spinning scanner.

    :param origin: (x, y) of the scanner, height: its z, between floor and ceiling [m]
    :param azimuths: (n,) [rad] in the world; slopes: (m,) rise over run
    :param floor: whether the floor and the ceiling are seen
    :return: (n, m) distance over the floor plan [m], inf where nothing is; (n, m) int surface id
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
        _meet(enter[prism, rows], leave[prism, rows], world.bottom[prism] - height, world.top[prism] - height, slopes,
              rows, prism, nearest, surface)
    return nearest, surface


def _meet(enter, leave, bottom, top, slopes, rows, prism, nearest, surface):
    """Note one prism where it is nearer than what is known."""
    rise = enter[:, np.newaxis] * slopes
    side = (rise >= bottom) & (rise <= top)
    with np.errstate(divide='ignore', invalid='ignore'):
        above, below = top / slopes, bottom / slopes
    # from above on its top, or from below on its underside
    flat = np.where(rise > top, above, below)
    on_flat = ~side & (flat > enter[:, np.newaxis]) & (flat < leave[:, np.newaxis])
    distance = np.where(side, enter[:, np.newaxis], np.where(on_flat, flat, np.inf))
    closer = distance < nearest[rows]
    nearest[rows] = np.where(closer, distance, nearest[rows])
    surface[rows] = np.where(closer, prism, surface[rows])
