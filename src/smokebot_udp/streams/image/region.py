# SPDX-License-Identifier: BSD-3-Clause
"""The region of an image stream: the part of the source's images that is sent."""
from typing import NamedTuple, Optional


class Region(NamedTuple):
    """A rectangle of pixels of the source."""
    x: int
    """First column."""
    y: int
    """First row."""
    width: int
    height: int

    def within(self, height: int, width: int, even: bool = False) -> 'Region':
        """The part of it in an image.

        :param even: whether it begins and ends between the 2 x 2 cells of a mosaic: it then grows at its upper left,
            and shrinks at its lower right, by at most a pixel
        :raises ValueError: nothing of it, or no such cell, is in the image
        """
        x, y = (self.x & ~1, self.y & ~1) if even else (self.x, self.y)
        right, below = min(self.x + self.width, width), min(self.y + self.height, height)
        if even:
            right, below = right & ~1, below & ~1
        if right <= x or below <= y:
            inside = self.x < width and self.y < height
            raise ValueError('region is %d, %d, %d, %d: %s of it is in an image of %d x %d pixels' % (
                *self, 'no whole cell of 2 x 2 pixels' if inside else 'nothing', width, height))
        return Region(x, y, right - x, below - y)


def whole(height: int, width: int) -> Region:
    """The region of a whole image."""
    return Region(0, 0, width, height)


def parse(text: str) -> Optional[Region]:
    """The setting `region`; None: it is empty, which is the whole image.

    :param text: x, y, width, height [pixel]
    :raises ValueError: naming it and its value
    """
    if not text.strip():
        return None
    words = text.replace(',', ' ').split()
    if len(words) != 4 or not all(word.isdecimal() and len(word) < 7 for word in words):
        raise ValueError("region is %r, must be x, y, width, height in pixels, as '480, 270, 960, 540'" % text)
    region = Region(*map(int, words))
    if not region.width or not region.height:
        raise ValueError('region is %r, its width and height must be at least 1' % text)
    return region
