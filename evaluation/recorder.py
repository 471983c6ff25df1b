# SPDX-License-Identifier: BSD-3-Clause
"""A listener that also records thermal images in a file; the `amount` of such a message is the image's index there.

    python3 -m evaluation.recorder FILE

It reports what experiments/link/adaptation.py needs of the link reports and of the robot's status, too.
"""
import pathlib
import sys
from typing import Any

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage, Image

from smokebot_udp.arrays import Array, UInt8Array
from smokebot_udp.msg import LinkReport, RobotStatus

from . import listener

WIDTH, HEIGHT = 320, 240

COLDEST, HOTTEST = 7400, 7900
"""Counts of 0.04 K that are shown black and white: 23 and 43 degC. Fires are white [count]."""


def to_grey(counts: Any) -> UInt8Array:
    """Counts as the grey levels that are shown, and that a JPEG holds: uint8."""
    share = (np.asarray(counts, np.float32) - COLDEST) / (HOTTEST - COLDEST)
    grey: UInt8Array = np.round(255 * np.clip(share, 0, 1)).astype(np.uint8)
    return grey


def to_counts(grey: UInt8Array) -> Array:
    """The inverse of to_grey, except for rounding and clipping: uint16."""
    counts: Array = np.round(COLDEST + grey.astype(np.float32) * (HOTTEST - COLDEST) / 255).astype(np.uint16)
    return counts


def load(path: pathlib.Path) -> Array:
    """The recorded images: (n, HEIGHT, WIDTH) uint16 [count]. An incomplete last one is left out."""
    values = np.fromfile(str(path), '<u2')
    return values[:len(values) // (HEIGHT * WIDTH) * HEIGHT * WIDTH].reshape(-1, HEIGHT, WIDTH)


class Recorder:
    """Appends images to a file."""

    def __init__(self, path: str) -> None:
        self._file = open(path, 'ab')   # noqa: SIM115  (until the node is killed)
        self._count = 0

    def append(self, counts: Array) -> int:
        """Write an image of counts; its index in the file."""
        self._file.write(np.ascontiguousarray(counts, '<u2').tobytes())
        self._file.flush()
        self._count += 1
        return self._count - 1


def main() -> None:
    """Run the node."""
    recorder = Recorder(sys.argv[1])
    listener.KINDS.update({
        'recorded image': (Image, lambda message: recorder.append(np.frombuffer(message.data, '<u2'))),
        'recorded jpeg': (CompressedImage, lambda message: recorder.append(to_counts(
            cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_GRAYSCALE)))),
        'report': (LinkReport, lambda message: {one.name: one.bytes for one in message.streams}),
        'status': (RobotStatus, lambda message: [message.focus, {one.name: one.share for one in message.streams}]),
    })
    listener.main()


if __name__ == '__main__':
    main()
