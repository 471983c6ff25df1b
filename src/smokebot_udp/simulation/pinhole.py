# SPDX-License-Identifier: BSD-3-Clause
"""A level pinhole camera: the depth and the surface seen at each pixel."""
from dataclasses import dataclass
from typing import Sequence, Tuple

import numpy as np

from ..arrays import Array, Float32Array
from .pose import Pose
from .rays import crossings, in_sight
from .world import CEILING, FLOOR, ROOF, World

NEAR = 0.05
"""Nearer surfaces are not seen [m]."""


@dataclass
class View:
    """The geometry of an image: (height, width) arrays."""
    depth: Float32Array
    """Along the optical axis [m]."""
    surface: Array
    """int16 surface ids: prism index, FLOOR or ROOF."""
    x: Float32Array
    """World coordinate x of the surface [m]."""
    y: Float32Array
    """World coordinate y of the surface [m]."""
    z: Float32Array
    """World coordinate z of the surface [m]."""


def remainder(values: Float32Array, period: float) -> Float32Array:
    """The remainder values % period. numpy's own takes ten times as long."""
    return np.asarray(values - np.float32(period) * np.floor(values * np.float32(1 / period)))


def warmth(view: View, fire: Sequence[float], spread: float) -> Float32Array:
    """1 / (1 + spread * squared distance over the floor plan) from a fire at (x, y, z): (height, width)."""
    squared = np.square(view.x - np.float32(fire[0]))
    squared += np.square(view.y - np.float32(fire[1]))
    squared *= np.float32(spread)
    squared += np.float32(1)
    return np.asarray(np.reciprocal(squared, out=squared))


@dataclass(frozen=True)
class Pinhole:
    """A camera that looks along the robot's heading, without pitch or roll."""
    width: int
    """[pixel]"""
    height: int
    """[pixel]"""
    field_of_view: float
    """Horizontal [rad]."""
    mount: float
    """Height above the floor [m]."""

    @property
    def focal_length(self) -> float:
        """[pixel]"""
        return float(self.width / 2 / np.tan(self.field_of_view / 2))

    def project(self, pose: Pose, point: Sequence[float]) -> Tuple[float, float, float]:
        """Project a point (x, y, z) [m] in front of the camera: (column, row) [pixel], and its depth [m]."""
        x, y, yaw = pose
        dx, dy = point[0] - x, point[1] - y
        depth = dx * np.cos(yaw) + dy * np.sin(yaw)
        right = dx * np.sin(yaw) - dy * np.cos(yaw)
        scale = self.focal_length / depth
        return (self.width - 1) / 2 + right * scale, (self.height - 1) / 2 - (point[2] - self.mount) * scale, depth

    def look(self, world: World, pose: Pose) -> View:
        """Render the geometry seen from a pose of the camera."""
        x, y, yaw = pose
        right = ((np.arange(self.width) - (self.width - 1) / 2) / self.focal_length).astype(np.float32)
        up = (((self.height - 1) / 2 - np.arange(self.height)) / self.focal_length).astype(np.float32)
        with np.errstate(divide='ignore'):
            level = np.where(up < 0, -self.mount / up, (CEILING - self.mount) / up)
        level = np.minimum(level, 1e3).astype(np.float32)
        depth = np.empty((self.height, self.width), np.float32)
        surface = np.empty(depth.shape, np.int16)
        depth[:], surface[:] = level[:, np.newaxis], np.where(up < 0, FLOOR, ROOF)[:, np.newaxis]
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        directions = ahead + right[:, np.newaxis] * np.array([ahead[1], -ahead[0]])
        enter, leave = crossings(world, (x, y), directions)
        seen = in_sight(world, enter, leave, NEAR)
        for prism in np.flatnonzero(seen.any(axis=1)):
            first, last = np.flatnonzero(seen[prism])[[0, -1]]
            columns = slice(first, last + 1)
            _draw(depth[:, columns], surface[:, columns], up, enter[prism, columns], leave[prism, columns],
                  world.bottom[prism] - self.mount, world.top[prism] - self.mount, prism)
        return View(depth, surface, np.float32(x) + depth * directions[:, 0].astype(np.float32),
                    np.float32(y) + depth * directions[:, 1].astype(np.float32),
                    np.float32(self.mount) + depth * up[:, np.newaxis])


def _draw(depth: Float32Array, surface: Array, up: Float32Array, enter: Float32Array, leave: Float32Array,
          bottom: float, top: float, prism: int) -> None:
    """Draw a prism's side, and its top or underside if visible, into the columns that it spans."""
    high, low = max(top / enter.min(), top / leave.max()), min(bottom / enter.min(), bottom / leave.max())
    # the rows whose slope lies between low and high
    rows = slice(int(np.searchsorted(-up, -high)), int(np.searchsorted(-up, -low, side='right')))
    depth, surface, up = depth[rows], surface[rows], up[rows, np.newaxis]
    rise = up * enter
    visible = enter < leave
    hit = np.where((rise >= bottom) & (rise <= top) & visible, enter, np.float32(np.inf))
    if top < 0 or bottom > 0:
        with np.errstate(divide='ignore', invalid='ignore'):
            flat = ((top if top < 0 else bottom) / up).astype(np.float32)
        on_flat = (flat > enter) & (flat < leave) & visible
        hit = np.where(on_flat, flat, hit)
    closer = hit < depth
    np.copyto(depth, hit, where=closer)
    np.copyto(surface, np.int16(prism), where=closer)
