# SPDX-License-Identifier: BSD-3-Clause
"""What cameras see: clips of 10 images a second, from the recordings and from a photograph."""
import math
import pathlib
from typing import Any, Dict, List

import cv2
import numpy as np
import skimage.data

from smokebot_udp.arrays import Array, UInt8Array

from .recordings import RECORDINGS

RATE = 10.0
"""Frame rate of all clips [Hz]."""

Clip = List[Array]
"""Images of one shape: (height, width) uint8 or uint16, or (height, width, 3) uint8: B, G, R."""

PHOTOGRAPH, HEIGHT, WIDTH = 'motorcycle_left.png', 240, 320
SWAY, SWAY_PERIOD = 16.0, 12.0
"""How far the simulated camera sways to each side [pixel], and how long it takes to come back [s]."""
ZOOM, ZOOM_PERIOD = 0.03, 9.0
NOISE = 1.5
"""Standard deviation of the simulated sensor's noise [count]."""

EUROC, CORRIDOR, THERMAL = 'seq_euroc_cam0_752x480_20hz', 'seq_rtabmap_corridor_512x384', 'seq_t1030sc_1024x768_30hz'
OFF_GRID = 4
"""The corridor's images were JPEGs: they are cut off their grid of 8 x 8 pixels, or a JPEG would cost nothing."""


def clips(count: int) -> Dict[str, Clip]:
    """All clips, of `count` images each: the simulated one, and those of the recordings that there are.

    * sway: a camera that sways and zooms before a photograph, in colour, with noise
    * euroc: a slowly flying camera, 752 x 480 grey, every second image of 20 Hz
    * corridor: keyframes in colour, 496 x 368: each shows another view
    * thermal: a hand-held thermal camera, 1024 x 768, every third image of 30 Hz, the central 99 % of its counts scaled
      to 8 bits

    A recording that is too short is continued backwards, then forwards again.
    """
    found = {'sway': swaying(count)}
    euroc, corridor, counts = (_files(name) for name in ('camera/' + EUROC, 'camera/' + CORRIDOR, 'thermal/' + THERMAL))
    if euroc:
        found['euroc'] = _bounced(_read(euroc[::2], cv2.IMREAD_GRAYSCALE), count)
    if corridor:
        cut = slice(OFF_GRID, -3 * OFF_GRID)
        found['corridor'] = _bounced([np.ascontiguousarray(image[cut, cut])
                                      for image in _read(corridor, cv2.IMREAD_COLOR)], count)
    if counts:
        found['thermal'] = _bounced(_scaled(_read(counts, cv2.IMREAD_UNCHANGED)), count, 3)
    return found


def small_clips(count: int) -> Dict[str, Clip]:
    """Clips for what is measured of layered images, where their recordings are; a standing camera has no noise.

    * thermal, standing: one image again and again, 640 x 480 uint16 [count]
    * thermal, moving: the centre of the clip `thermal`, as the camera gave it: 640 x 480 uint16 [count]
    * euroc, small: the clip `euroc`, 320 x 240
    """
    found: Dict[str, Clip] = {}
    counts, euroc = _files('thermal/' + THERMAL), _files('camera/' + EUROC)
    if counts:
        images = [np.ascontiguousarray(image[144:624, 192:832]) for image in _read(counts, cv2.IMREAD_UNCHANGED)]
        found['thermal, standing'] = images[:1] * count
        found['thermal, moving'] = _bounced(images, count, 3)
    if euroc:
        found['euroc, small'] = _bounced([cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)
                                          for image in _read(euroc[::2], cv2.IMREAD_GRAYSCALE)], count)
    return found


def swaying(count: int) -> Clip:
    """What a camera sees that sways and zooms before a photograph: (HEIGHT, WIDTH, 3) uint8 each."""
    photograph = cv2.imread(str(pathlib.Path(skimage.data.__file__).parent / PHOTOGRAPH))
    random = np.random.RandomState(1)
    centre = np.array(photograph.shape[1::-1]) / 2
    images = []
    for number in range(count):
        sway, zoom = (2 * math.pi * number / RATE / period for period in (SWAY_PERIOD, ZOOM_PERIOD))
        scale = 1 + ZOOM * math.sin(zoom)
        x, y = centre + [SWAY * math.sin(sway), SWAY / 4 * math.sin(2 * sway)]
        matrix = np.array([[scale, 0, x - scale * WIDTH / 2], [0, scale, y - scale * HEIGHT / 2]])
        seen = cv2.warpAffine(photograph, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        noisy = seen + random.normal(0, NOISE, seen.shape[:2])[:, :, np.newaxis]
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return images


def _files(folder: str) -> List[pathlib.Path]:
    return sorted(RECORDINGS.joinpath(folder).glob('*.*'))


def _read(files: List[pathlib.Path], how: int) -> List[Any]:
    return [cv2.imread(str(file), how) for file in files]


def _bounced(images: Clip, count: int, step: int = 1) -> Clip:
    """Every step-th image, forwards and backwards in turns."""
    places = [number * step % max(2 * len(images) - 2, 1) for number in range(count)]
    return [images[min(place, 2 * len(images) - 2 - place)] for place in places]


def _scaled(images: Clip) -> List[UInt8Array]:
    some = np.concatenate([image[::8, ::8].ravel() for image in images])
    low, high = np.asarray(np.percentile(some, (0.5, 99.5)))
    return [np.clip(np.rint((image - low) * (255 / (high - low))), 0, 255).astype(np.uint8) for image in images]
