# SPDX-License-Identifier: BSD-3-Clause
"""What to measure with: scikit-image's photographs, and recordings where they lie beside this checkout."""
import pathlib
from typing import Dict, Iterator, Mapping

import cv2
import numpy as np
import skimage.data

from smokebot_udp.arrays import Array, Float32Array, UInt8Array
from smokebot_udp.simulation.pinhole import Pinhole
from smokebot_udp.simulation.thermal import ThermalCamera
from smokebot_udp.simulation.world import building

from . import TOP

RECORDINGS = TOP.parent / 'shared' / 'data'

SKIMAGE_PHOTOGRAPHS = (
    'astronaut', 'brick', 'camera', 'chelsea', 'coffee', 'coins', 'grass', 'gravel', 'hubble_deep_field', 'moon',
    'motorcycle_left', 'page', 'rocket')

CAMERA_FOLDERS = {'seq_euroc_cam0_752x480_20hz': 30, 'seq_rtabmap_corridor_512x384': 19, 'single_tum_640x480': 4,
                  'single_acfr_lab_1920x1208': 1}
"""{folder of recordings: every n-th image is used}"""

THERMAL_FOLDERS = {'seq_t1030sc_1024x768_30hz': 4, 'seq_sc660_640x480': 1, 'single': 1}
"""{folder of recordings: every n-th image is used}"""


def photographs(width: int, height: int) -> Dict[str, UInt8Array]:
    """Greyscale photographs, cropped to this aspect ratio and resized: {name: (height, width) uint8}."""
    folder = pathlib.Path(skimage.data.__file__).parent
    files = [next(folder.glob(name + '.*')) for name in SKIMAGE_PHOTOGRAPHS]
    files += _recorded('camera', CAMERA_FOLDERS)
    images = {_name(file): cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files}
    return {name: _resized(image, width, height) for name, image in images.items()}


def thermal() -> Dict[str, Array]:
    """Radiometric recordings as they are, and a simulated image: {name: (height, width) uint16 [count]}."""
    images = {_name(file): cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in _recorded(
        'thermal', THERMAL_FOLDERS)}
    for file in sorted(RECORDINGS.glob('thermal/seq_lepton*/*.npz')):
        with np.load(str(file)) as arrays:
            images['lepton_' + file.stem] = arrays['frames'][0]
    camera = ThermalCamera(building(1), Pinhole(640, 480, 1.2, 0.6), 1)
    return {**images, 'simulated': camera.look((1.5, 7.0, 0.3), 0.0)}


def cloud_points(path: pathlib.Path) -> Float32Array:
    """The points of a recorded cloud's file: (n, 3) [m]."""
    if path.suffix == '.npz':
        with np.load(str(path)) as arrays:
            return arrays['xyz'].reshape(-1, 3)
    import pcl
    return np.asarray(pcl.load(str(path)))


def _recorded(kind: str, folders: Mapping[str, int]) -> Iterator[pathlib.Path]:
    for folder, step in folders.items():
        yield from sorted(RECORDINGS.joinpath(kind, folder).glob('*.*'))[::step]


def _name(file: pathlib.Path) -> str:
    folder = file.parent.name
    return file.stem if folder in ('data', 'single') else '%s_%s' % (folder.split('_')[1], file.stem[-6:])


def _resized(image: UInt8Array, width: int, height: int) -> UInt8Array:
    rows, columns = image.shape
    high, wide = min(rows, columns * height // width), min(columns, rows * width // height)
    top, left = (rows - high) // 2, (columns - wide) // 2
    resized: UInt8Array = cv2.resize(image[top:top + high, left:left + wide], (width, height),
                                     interpolation=cv2.INTER_AREA)
    return resized
