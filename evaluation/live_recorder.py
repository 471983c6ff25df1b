# SPDX-License-Identifier: BSD-3-Clause
"""A listener that records grey images in a file; the `amount` of such a message is the image's index there.

    python3 -m evaluation.live_recorder FILE
"""
import sys
from typing import Any

from sensor_msgs.msg import Image

from smokebot_udp.msg import LinkStatus

from . import listener

LINK_FIELDS = 'rate', 'sent', 'wanted', 'capacity', 'queue_delay', 'round_trip', 'loss'


class ImageFile:
    """Appends images to a file."""

    def __init__(self, path: str) -> None:
        self._file = open(path, 'ab')   # noqa: SIM115  (until the process ends)
        self._count = 0

    def append(self, pixels: bytes) -> int:
        """Write an image; its index in the file."""
        self._file.write(pixels)
        self._file.flush()
        self._count += 1
        return self._count - 1


def main() -> None:
    """Run the node."""
    file = ImageFile(sys.argv[1])

    def recorded(message: Any) -> int:
        return file.append(message.data)
    listener.KINDS.update({
        'recorded grey': (Image, recorded),
        'link': (LinkStatus, lambda message: {name: getattr(message, name) for name in LINK_FIELDS})})
    listener.main()


if __name__ == '__main__':
    main()
