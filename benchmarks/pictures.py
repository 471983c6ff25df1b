# SPDX-License-Identifier: BSD-3-Clause
"""Pictures to measure with: scikit-image's, and recordings where they lie beside this checkout."""
import pathlib

import cv2
import numpy as np
import skimage.data

from smokebot_udp.simulation.pinhole import Pinhole
from smokebot_udp.simulation.thermal import ThermalCamera
from smokebot_udp.simulation.world import building

TOP = pathlib.Path(__file__).resolve().parent.parent
RECORDINGS = TOP.parent / 'shared' / 'data'

BEST_PSNR = 60.0
"""What is nearer to the truth than this is not told apart [dB]."""

OF_SKIMAGE = ('astronaut', 'brick', 'camera', 'chelsea', 'coffee', 'coins', 'grass', 'gravel', 'hubble_deep_field',
              'moon', 'motorcycle_left', 'page', 'rocket')

OF_CAMERAS = {'seq_euroc_cam0_752x480_20hz': 30, 'seq_rtabmap_corridor_512x384': 19, 'single_tum_640x480': 4,
              'single_acfr_lab_1920x1208': 1}
"""{folder of recordings: each so manieth picture is taken}"""

OF_THERMAL = {'seq_t1030sc_1024x768_30hz': 4, 'seq_sc660_640x480': 1, 'single': 1}


def psnr(truth, shown):
    """Of two pictures of bytes, BEST_PSNR at most [dB]."""
    error = np.mean((truth.astype(float) - shown) ** 2)
    return min(BEST_PSNR, 10 * np.log10(255 ** 2 / error)) if error else BEST_PSNR


def grey(width, height):
    """{name: (height, width) uint8}: photographs, cut to this shape and reduced to this size."""
    folder = pathlib.Path(skimage.data.__file__).parent
    files = [next(folder.glob(name + '.*')) for name in OF_SKIMAGE] + list(_recorded('camera', OF_CAMERAS))
    pictures = {_name(file): cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files}
    return {name: _sized(picture, width, height) for name, picture in pictures.items()}


def thermal():
    """{name: (height, width) uint16 counts}: radiometric recordings as they are, and a simulated one."""
    pictures = {_name(file): cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in _recorded('thermal', OF_THERMAL)}
    for file in sorted(RECORDINGS.glob('thermal/seq_lepton*/*.npz')):
        with np.load(str(file)) as arrays:
            pictures['lepton_' + file.stem] = arrays['frames'][0]
    camera = ThermalCamera(building(1), Pinhole(640, 480, 1.2, 0.6), 1)
    return {**pictures, 'simulated': camera.look((1.5, 7.0, 0.3), 0.0)}


def _recorded(kind, folders):
    for folder, step in folders.items():
        yield from sorted(RECORDINGS.joinpath(kind, folder).glob('*.*'))[::step]


def _name(file):
    folder = file.parent.name
    return file.stem if folder in ('data', 'single') else '%s_%s' % (folder.split('_')[1], file.stem[-6:])


def _sized(picture, width, height):
    rows, columns = picture.shape
    high, wide = min(rows, columns * height // width), min(columns, rows * width // height)
    top, left = (rows - high) // 2, (columns - wide) // 2
    return cv2.resize(picture[top:top + high, left:left + wide], (width, height), interpolation=cv2.INTER_AREA)
