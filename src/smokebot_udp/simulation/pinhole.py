# SPDX-License-Identifier: BSD-3-Clause
"""What a level pinhole camera sees of the world: for each pixel how far, and which surface."""
from dataclasses import dataclass

import numpy as np

from .rays import crossings, in_sight
from .world import CEILING, FLOOR, ROOF

NEAR = 0.05


@dataclass
class View:
    """A picture's geometry; all (height, width) arrays."""
    depth: np.ndarray     # along the optical axis [m], float32
    surface: np.ndarray   # prism index, FLOOR or ROOF, int16
    x: np.ndarray         # where the surface is seen, in the world [m], float32
    y: np.ndarray
    z: np.ndarray


@dataclass(frozen=True)
class Pinhole:
    """A camera that looks along the robot's heading, without pitch or roll."""
    width: int
    height: int
    field_of_view: float   # horizontal [rad]
    mount: float           # above the floor [m]

    @property
    def focal_length(self):
        """[pixel]"""
        return self.width / 2 / np.tan(self.field_of_view / 2)

    def project(self, pose, point):
        """(column, row) of a point (x, y, z), and its depth; for what is before the camera."""
        x, y, yaw = pose
        dx, dy = point[0] - x, point[1] - y
        depth = dx * np.cos(yaw) + dy * np.sin(yaw)
        right = dx * np.sin(yaw) - dy * np.cos(yaw)
        scale = self.focal_length / depth
        return (self.width - 1) / 2 + right * scale, (self.height - 1) / 2 - (point[2] - self.mount) * scale, depth

    def look(self, world, pose):
        """:param pose: (x, y, yaw) of the camera; :return: View"""
        x, y, yaw = pose
        right = ((np.arange(self.width) - (self.width - 1) / 2) / self.focal_length).astype(np.float32)
        up = (((self.height - 1) / 2 - np.arange(self.height)) / self.focal_length).astype(np.float32)
        with np.errstate(divide='ignore'):
            level = np.where(up < 0, -self.mount / up, (CEILING - self.mount) / up)
        level = np.minimum(level, 1e3).astype(np.float32)
        depth = np.repeat(level[:, np.newaxis], self.width, axis=1)
        surface = np.repeat(np.where(up < 0, FLOOR, ROOF).astype(np.int16)[:, np.newaxis], self.width, axis=1)
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        directions = ahead + right[:, np.newaxis] * np.array([ahead[1], -ahead[0]])
        enter, leave = crossings(world, (x, y), directions)
        seen = in_sight(world, enter, leave, NEAR)
        for prism in np.flatnonzero(seen.any(axis=1)):
            first, last = np.flatnonzero(seen[prism])[[0, -1]]
            columns = slice(first, last + 1)
            self._draw(depth[:, columns], surface[:, columns], up, enter[prism, columns], leave[prism, columns],
                       world.bottom[prism] - self.mount, world.top[prism] - self.mount, prism)
        return View(depth, surface, np.float32(x) + depth * directions[:, 0].astype(np.float32),
                    np.float32(y) + depth * directions[:, 1].astype(np.float32),
                    np.float32(self.mount) + depth * up[:, np.newaxis])

    def _draw(self, depth, surface, up, enter, leave, bottom, top, prism):
        """One prism's side, and its top or underside where they are seen, into the columns it spans."""
        high, low = max(top / enter.min(), top / leave.max()), min(bottom / enter.min(), bottom / leave.max())
        first, last = self._rows(up, low, high)
        rows, up = slice(first, last), up[first:last, np.newaxis]
        depth, surface = depth[rows], surface[rows]
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

    def _rows(self, up, low, high):
        """The rows whose slope lies between low and high."""
        return int(np.searchsorted(-up, -high)), int(np.searchsorted(-up, -low, side='right'))
