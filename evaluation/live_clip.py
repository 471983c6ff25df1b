# SPDX-License-Identifier: BSD-3-Clause
"""What the camera of `bench live` sees: a recorded clip forwards and backwards, or a simulated camera; 10 Hz, grey."""
import pathlib
from typing import List

import cv2
import numpy as np

from smokebot_udp.arrays import UInt8Array
from smokebot_udp.simulation import mounts
from smokebot_udp.simulation.camera import Camera
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.pinhole import Pinhole
from smokebot_udp.simulation.world import building

from .recordings import RECORDINGS
from .video_clips import EUROC, RATE

WIDTH, HEIGHT = 752, 480
"""Width and height of recorded and of simulated images [pixel]."""

SIMULATED = 30
"""Number of simulated images."""


class Clip:
    """Images by their number from the start, without end.

    :param folder: of the recorded images, 20 a second; where it holds none, they are simulated
    """

    def __init__(self, folder: pathlib.Path = RECORDINGS / 'camera' / EUROC) -> None:
        files = sorted(folder.glob('*.png'))[::2]
        self.name = 'euroc' if files else 'simulated'
        self._images: List[UInt8Array] = [
            cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files] or simulated(SIMULATED)

    def image(self, number: int) -> UInt8Array:
        """(HEIGHT, WIDTH) uint8."""
        return self._images[place(number, len(self._images))]


def place(number: int, count: int) -> int:
    """Where an image is in a clip of `count` images that is played forwards and backwards in turns."""
    at = number % max(2 * count - 2, 1)
    return min(at, 2 * count - 2 - at)


def simulated(count: int) -> List[UInt8Array]:
    """What the simulated robot's camera sees along its drive."""
    drive = Drive()
    camera = Camera(building(1), Pinhole(WIDTH, HEIGHT, np.radians(70), mounts.CAMERA), seed=1)
    return [cv2.cvtColor(camera.look(drive.pose(number / RATE), number / RATE), cv2.COLOR_BGR2GRAY)
            for number in range(count)]
