# SPDX-License-Identifier: BSD-3-Clause
"""A screen without hardware (Xvfb), and what a program shows on it."""
import os
import pathlib
import struct
import subprocess
import tempfile
from typing import Any, Dict, List, Tuple

import cv2
import numpy as np

from smokebot_udp.nodes.rviz_config import generated
from smokebot_udp.streams import config

from . import TOP

RVIZ_SIZE = 1280, 900
"""(width, height) of the window of operator.rviz [pixel]."""

Region = Tuple[int, int, int, int]
"""(left, top, right, bottom) [pixel]"""

Colour = Tuple[int, int, int]
"""(red, green, blue)"""

WORDS = 25
"""Number of words in the header of the XWD format, big-endian: header size, ..., number of colour map entries, see
XWDFile.h."""

COLOUR_MAP_ENTRY = 12
"""Size of an entry of the colour map [byte]."""


def operator_rviz(folder: pathlib.Path, streams: pathlib.Path = TOP / 'config' / 'streams.yaml') -> List[str]:
    """The command that starts rviz as operator.launch does, but with few frames a second: each takes long to draw.

    :param folder: for its configuration
    :param streams: streams.yaml
    """
    text = generated((TOP / 'rviz' / 'operator.rviz').read_text(), config.load(streams.read_text())[0])
    assert 'Frame Rate: 30' in text
    path = folder / 'operator.rviz'
    path.write_text(text.replace('Frame Rate: 30', 'Frame Rate: 5'))
    return ['rosrun', 'smokebot_udp', 'rviz_keeper', '-d', str(path), '--streams', str(streams)]


class Screen:
    """Lives until `close`.

    :param size: (width, height) [pixel]
    """

    def __init__(self, size: Tuple[int, int]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix='screen_')
        read_end, write_end = os.pipe()
        # it chooses a free number
        self._process = subprocess.Popen(
            ['Xvfb', '-displayfd', str(write_end), '-screen', '0', '%dx%dx24' % size, '-fbdir', self._folder.name,
             '-nolisten', 'tcp'], pass_fds=[write_end], stderr=subprocess.DEVNULL)
        os.close(write_end)
        with os.fdopen(read_end) as answer:
            number = answer.readline().strip()
        if not number:
            raise OSError('Xvfb does not start: exit code %r' % self._process.wait())
        self.environment: Dict[str, str] = {'DISPLAY': ':' + number, 'LIBGL_ALWAYS_SOFTWARE': '1',
                                            'HOME': self._folder.name}
        """For programs that show something there."""

    def shot(self) -> Any:
        """(height, width, 3) uint8, bgr: what is shown now."""
        data = pathlib.Path(self._folder.name, 'Xvfb_screen0').read_bytes()
        header = struct.unpack_from('>%dI' % WORDS, data)
        width, height, line, colours = header[4], header[5], header[12], header[19]
        pixels = np.frombuffer(data, np.uint8, line * height, header[0] + COLOUR_MAP_ENTRY * colours)
        return pixels.reshape(height, line)[:, :4 * width].reshape(height, width, 4)[..., :3]

    def save(self, path: str) -> None:
        """Write what is shown now to an image file."""
        cv2.imwrite(path, self.shot())

    def count(self, region: Region, colour: Colour, tolerance: int = 24) -> int:
        """The number of pixels in a region that have a colour.

        :param tolerance: of each component
        """
        left, top, right, bottom = region
        difference = np.abs(self.shot()[top:bottom, left:right, ::-1].astype(int) - colour)
        return int(np.count_nonzero((difference <= tolerance).all(axis=2)))

    def close(self) -> None:
        self._process.terminate()
        self._process.wait()
        self._folder.cleanup()
