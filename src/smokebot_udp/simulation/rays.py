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
    :return: (n, P) enter, (n, P) leave, float32; enter > leave where a ray passes by
    """
    slope = np.einsum('pij,nj->npi', world.normals, directions)
    room = world.offsets - world.normals @ np.asarray(origin, float)
    with np.errstate(divide='ignore', invalid='ignore'):
        at = room / slope
    parallel_outside = (slope == 0) & (room < 0)
    enter = np.where(slope < 0, at, -np.inf).max(axis=2)
    leave = np.where(slope > 0, at, np.inf).min(axis=2)
    enter[parallel_outside.any(axis=2)] = np.inf
    return enter.astype(np.float32), leave.astype(np.float32)


def ranges(world, origin, height, azimuths, slopes, floor=True):
    """The nearest surface of each ray of a spinning scanner.

    :param origin: (x, y) of the scanner, height: its z [m]
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
    for prism in np.flatnonzero((enter < leave).any(axis=0)):
        rows = np.flatnonzero((enter[:, prism] < leave[:, prism]) & (leave[:, prism] > 0) & (enter[:, prism] > 0))
        if not len(rows):
            continue
        _meet(enter[rows, prism], leave[rows, prism], world.bottom[prism] - height, world.top[prism] - height, slopes,
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
