# SPDX-License-Identifier: BSD-3-Clause
"""The colour camera: lit by the fires and by a lamp on the robot, with smoke that hides what is far."""
import cv2
import numpy as np

from ..arrays import Array, Float32Array, UInt8Array
from .noise import NoisePool
from .pinhole import Pinhole, View, remainder, warmth
from .pose import Pose
from .smoke import Smoke
from .world import FLOOR, World

SMOKE = np.array((92, 96, 100), np.float32)
"""Colour of the smoke, BGR."""

FLOOR_COLOUR, ROOF_COLOUR = (95, 105, 115), (150, 150, 150)
"""BGR"""


class Camera:
    """:param smoke: extinction [1/m]; at 0.25 a wall 4 m away keeps a third of its contrast
    :param billows: of the smoke, 0..1, see Smoke
    :param noise: standard deviation of a pixel [of 255]
    """

    def __init__(self, world: World, pinhole: Pinhole, seed: int, smoke: float = 0.22, billows: float = 0.0,
                 noise: float = 2.0) -> None:
        self.world, self.pinhole, self._smoke = world, pinhole, Smoke(pinhole, smoke, billows, seed)
        self._noise = NoisePool((pinhole.height, pinhole.width), seed + 1, noise) if noise else None
        self._colours = np.concatenate([world.colour, (ROOF_COLOUR, FLOOR_COLOUR)]).T.astype(np.float32).copy()

    def look(self, pose: Pose, time: float) -> UInt8Array:
        """Take an image from a pose at a time [s]: (height, width, 3) uint8, BGR."""
        view = self.pinhole.look(self.world, pose)
        shade = _texture(view) * (0.35 + 0.65 / (1 + 0.06 * np.square(view.depth)))
        fires = self.world.flicker > 0
        bright = ((self.world.temperatures(time) - self.world.ambient) / 600)[fires]
        glow = np.zeros_like(shade)
        for fire, strength in zip(self.world.fires, bright):
            cv2.scaleAdd(warmth(view, fire, 1.0), strength, glow, glow)
        clear = self._smoke.clear(view, pose[2], time)
        burning = np.isin(view.surface, np.flatnonzero(fires))
        shade[burning] = 1.2
        shade *= clear
        glow *= clear
        veil = 1 - clear
        channels = []
        for channel, (smoke, fire) in enumerate(zip(SMOKE, (25, 90, 160))):
            # ROOF and FLOOR are the last two
            seen: Array = np.take(self._colours[channel], view.surface, mode='wrap')
            seen *= shade
            cv2.scaleAdd(glow, fire, seen, seen)
            cv2.scaleAdd(veil, float(smoke), seen, seen)
            if self._noise is not None:
                seen += self._noise.draw(time + 0.01 * channel)
            channels.append(cv2.convertScaleAbs(seen))
        return np.asarray(cv2.merge(channels))


def _texture(view: View) -> Float32Array:
    """Tiles on the floor and boards on the walls, which make motion visible."""
    boards = np.abs(remainder((view.x + view.y) * 1.25, 1) - 0.5) > 0.47
    texture = 1 - np.float32(0.3) * boards
    below = slice(texture.shape[0] // 2, None)      # the horizon is in the middle
    x, y, z, surface = (one[below] for one in (view.x, view.y, view.z, view.surface))
    tiles = remainder(np.floor(2.0 * x) + np.floor(2.0 * y), 2)
    np.copyto(texture[below], np.float32(0.8) + np.float32(0.25) * tiles, where=surface == FLOOR)
    texture[below][(surface >= 0) & (z < 0.12)] -= np.float32(0.4)
    return np.asarray(texture)
