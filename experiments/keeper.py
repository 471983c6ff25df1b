# SPDX-License-Identifier: BSD-3-Clause
"""A lab's listener that keeps thermal pictures in the order in which they come: `amount` is a picture's place in FILE.

    python3 -m experiments.keeper FILE

It tells what adaptation.py needs of the link's reports and of the robot's status, too.
"""
import sys

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage, Image

from smokebot_udp.link_lab import listener
from smokebot_udp.msg import LinkReport, RobotStatus

WIDTH, HEIGHT = 320, 240

COLDEST, HOTTEST = 7400, 7900
"""Of 0.04 K: what is shown, from black to white, is 23 to 43 degC; fires are white [counts]."""


def to_grey(counts):
    """What an eye sees of counts: uint8, as a JPEG takes it."""
    share = (np.asarray(counts, np.float32) - COLDEST) / (HOTTEST - COLDEST)
    return np.round(255 * np.clip(share, 0, 1)).astype(np.uint8)


def to_counts(grey):
    """The inverse, but for what is rounded and cut: uint16."""
    return np.round(COLDEST + grey.astype(np.float32) * (HOTTEST - COLDEST) / 255).astype(np.uint16)


def load(path):
    """(n, HEIGHT, WIDTH) uint16 counts; one more may be being written."""
    values = np.fromfile(str(path), '<u2')
    return values[:len(values) // (HEIGHT * WIDTH) * HEIGHT * WIDTH].reshape(-1, HEIGHT, WIDTH)


def main():
    kept, file = [0], open(sys.argv[1], 'ab')   # noqa: SIM115  (until the node is killed)

    def keep(counts):
        file.write(np.ascontiguousarray(counts, '<u2').tobytes())
        file.flush()
        kept[0] += 1
        return kept[0] - 1

    listener.KINDS.update({
        'kept image': (Image, lambda message: keep(np.frombuffer(message.data, '<u2'))),
        'kept jpeg': (CompressedImage, lambda message: keep(to_counts(
            cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_GRAYSCALE)))),
        'report': (LinkReport, lambda message: {one.name: one.bytes for one in message.streams}),
        'status': (RobotStatus, lambda message: [message.focus, {one.name: one.share for one in message.streams}]),
    })
    listener.main()


if __name__ == '__main__':
    main()
