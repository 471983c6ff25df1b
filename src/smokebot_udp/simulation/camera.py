# SPDX-License-Identifier: BSD-3-Clause
"""The colour camera: lit by the fires and by a lamp on the robot, with smoke that hides what is far."""
import cv2
import numpy as np

from ..arrays import Array, Float32Array, UInt8Array
from .noise import NoisePool
from .pinhole import Pinhole, View, remainder, warmth
from .pose import Pose
from .world import FLOOR, World

SMOKE = np.array((92, 96, 100), np.float32)
"""Colour of the smoke, BGR."""

FLOOR_COLOUR, ROOF_COLOUR = (95, 105, 115), (150, 150, 150)
"""BGR"""


class Camera:
    """:param smoke: extinction [1/m]; at 0.25 a wall 4 m away keeps a third of its contrast
    :param noise: standard deviation of a pixel [of 255]
    """

    def __init__(self, world: World, pinhole: Pinhole, seed: int, smoke: float = 0.22, noise: float = 2.0) -> None:
        self.world, self.pinhole, self.smoke = world, pinhole, smoke
        self._noise = NoisePool((pinhole.height, pinhole.width), seed + 1, noise) if noise else None
        self._colours = np.concatenate([world.colour, (ROOF_COLOUR, FLOOR_COLOUR)]).T.astype(np.float32).copy()

    def look(self, pose: Pose, time: float) -> UInt8Array:
        """Take an image from a pose at a time [s]: (height, width, 3) uint8, BGR."""
        view = self.pinhole.look(self.world, pose)
        shade = _texture(view) * (0.35 + 0.65 / (1 + 0.06 * np.square(view.depth)))
        fires = self.world.flicker > 0
        bright = ((self.world.temperatures(time) - self.world.ambient) / 600)[fires]
        glow = sum(np.float32(b) * warmth(view, f, 1.0) for f, b in zip(self.world.fires, bright))
        thick = self.smoke * (0.6 + 0.4 * np.minimum(view.z, 2.7)) * (1 + 0.15 * np.sin(0.7 * time))
        clear = np.exp(-thick * view.depth)
        burning = np.isin(view.surface, np.flatnonzero(fires))
        shade[burning] = 1.2
        channels = []
        for channel, (smoke, fire) in enumerate(zip(SMOKE, (25, 90, 160))):
            # ROOF and FLOOR are the last two
            seen: Array = np.take(self._colours[channel], view.surface, mode='wrap')
            seen *= shade
            seen += fire * glow
            seen -= smoke
            seen *= clear
            seen += smoke
            if self._noise is not None:
                seen += self._noise.draw(time + 0.01 * channel)
            channels.append(cv2.convertScaleAbs(np.maximum(seen, 0, out=seen)))
        return np.asarray(cv2.merge(channels))


def _texture(view: View) -> Float32Array:
    """Tiles on the floor and boards on the walls, which make motion visible."""
    tiles = remainder(np.floor(2.0 * view.x) + np.floor(2.0 * view.y), 2)
    boards = np.abs(remainder((view.x + view.y) * 1.25, 1) - 0.5) > 0.47
    texture = np.float32(0.8) + np.float32(0.25) * tiles
    others = view.surface != FLOOR
    np.copyto(texture, 1 - np.float32(0.3) * boards, where=others)
    texture[(view.surface >= 0) & (view.z < 0.12)] -= np.float32(0.4)
    return np.asarray(texture)
