# SPDX-License-Identifier: BSD-3-Clause
"""What several screens showed at the same moments, as a strip of images and as a film."""
import bisect
from typing import List, Mapping, NamedTuple, Optional, Sequence, Tuple

import cv2
import numpy as np

from ..arrays import UInt8Array
from ..codecs.display.view import WHITE, duration, write
from ..optional import attempt

CELL = 320, 240
"""(width, height) of an image [pixel]"""

CAPTION = 26
"""Height of the text below an image, or above a row [pixel]."""

FILM_RATE = 5
"""Frame rate of a film [Hz]."""

FILM_BITS = 6e5
"""Bit rate of a film [bit/s]."""


class Seen(NamedTuple):
    """An image on a screen."""
    when: float
    """Time at which the image appeared [s]."""
    stamp: float
    """Time at which the image was taken, by the same clock [s]."""
    jpeg: bytes
    """(height, width, 3) uint8 BGR, compressed."""


Screens = Mapping[str, Sequence[Seen]]
"""{title: what the screen showed, in the order of its appearance}"""


def at(seen: Sequence[Seen], moment: float) -> Optional[Seen]:
    """What a screen showed at a moment; None: nothing yet."""
    before = bisect.bisect_right([one.when for one in seen], moment)
    return seen[before - 1] if before else None


def moments(first: float, last: float, count: int) -> List[float]:
    """The ends of `count` equal parts of a time [s]."""
    return [first + (last - first) * (number + 1) / count for number in range(count)]


def caption(seen: Optional[Seen], moment: float) -> str:
    """The age of what is seen at a moment, in words."""
    return 'nothing yet' if seen is None else 'age ' + duration(max(0.0, moment - seen.stamp))


def cell(seen: Optional[Seen], moment: float) -> UInt8Array:
    """(CELL's height + CAPTION, width, 3) uint8 BGR: what is seen at a moment, above its age."""
    width, height = CELL
    image = np.zeros((height + CAPTION, width, 3), np.uint8)
    if seen is not None:
        pixels = cv2.imdecode(np.frombuffer(seen.jpeg, np.uint8), cv2.IMREAD_COLOR)
        size = _within(pixels.shape[1], pixels.shape[0])
        left, top = (width - size[0]) // 2, (height - size[1]) // 2
        image[top:top + size[1], left:left + size[0]] = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    write(image[height:], caption(seen, moment), (4, 0, width - 8, CAPTION), WHITE)
    return image


def strip(screens: Screens, when: Sequence[float]) -> UInt8Array:
    """(rows, columns, 3) uint8 BGR: a row for each screen below its title, a column for each moment."""
    rows: List[UInt8Array] = []
    for title, seen in screens.items():
        row = np.hstack([cell(at(seen, moment), moment) for moment in when])
        rows += [_bar(title, row.shape[1]), row]
    return np.vstack(rows)


def film_frame(screens: Screens, moment: float) -> UInt8Array:
    """(rows, columns, 3) uint8 BGR: the screens at a moment, two beside each other."""
    cells = [np.vstack([_bar(title, CELL[0]), cell(at(seen, moment), moment)]) for title, seen in screens.items()]
    if len(cells) % 2:
        cells.append(np.zeros_like(cells[0]))
    return np.vstack([np.hstack(cells[first:first + 2]) for first in range(0, len(cells), 2)])


def write_film(path: str, screens: Screens, first: float, last: float) -> bool:
    """Write a film of H.264; False: PyAV cannot be used.

    :param first, last: the time that it shows [s]
    """
    av = attempt('av').module
    if av is None:
        return False
    with av.open(path, 'w') as container:
        height, width = film_frame(screens, first).shape[:2]
        stream = container.add_stream('libx264', rate=FILM_RATE)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = width, height, 'yuv420p', int(FILM_BITS)
        for moment in np.arange(first, last, 1 / FILM_RATE):
            frame = av.VideoFrame.from_ndarray(film_frame(screens, float(moment)), format='bgr24')
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return True


def _within(width: int, height: int) -> Tuple[int, int]:
    scale = min(CELL[0] / width, CELL[1] / height)
    return max(1, round(width * scale)), max(1, round(height * scale))


def _bar(title: str, width: int) -> UInt8Array:
    bar = np.zeros((CAPTION, width, 3), np.uint8)
    bar[:] = (70, 50, 30)
    write(bar, title, (4, 0, width - 8, CAPTION), WHITE)
    return bar
