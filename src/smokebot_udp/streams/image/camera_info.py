# SPDX-License-Identifier: BSD-3-Clause
"""The region of a camera's images that is sent, and the calibration of images that are cut and scaled
(sensor_msgs/CameraInfo, image_transport's topic names)."""
import copy
from typing import List, NamedTuple, Optional, Tuple

from sensor_msgs.msg import CameraInfo, RegionOfInterest

from ...mission.parameters import Parameter

TRANSPORTS = 'compressed', 'compressedDepth', 'theora'
"""Last names of topics beside an image's topic, as image_transport has them."""

CAMERA_INFO = 'camera_info'

SETTING = Parameter(False, '', 'whether camera_info beside robot_topic crosses: it is published beside operator_topic '
                    'with the stamp of each image, of its region and scale')


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


def parse_region(text: str) -> Optional[Region]:
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


def info_topic(image_topic: str) -> str:
    """The topic of the camera_info of an image topic: beside it, or beside the raw topic of a compressed one.

    :param image_topic: such as /camera/image_raw or /camera/image_raw/compressed
    """
    names = image_topic.split('/')
    if names[-1] in TRANSPORTS and len(names) > 1:
        names = names[:-1]
    return '/'.join([*names[:-1], CAMERA_INFO])


def part_info(info: CameraInfo, region: Region, source: Tuple[int, int], scale: int) -> CameraInfo:
    """The calibration of an image of which a region is sent, reduced by a factor.

    The centre of pixel 0 is at 0. The mean of a block of pixels is at the block's centre, so a place x becomes
    (x - region.x + 0.5) / scale - 0.5. Distortion and rectification are of directions, and stay.

    :param info: of the source's images
    :param region: of them
    :param source: (height, width) of the source's images [pixel]
    :param scale: reduction factor
    :return: without binning and region of interest, unless the whole image is sent in full size
    :raises ValueError: it is not of images of this size
    """
    found = copy.copy(info)
    if (info.height, info.width) == (0, 0):     # a camera without calibration
        found.height, found.width = source
        return found if region == whole(*source) and scale == 1 else _sized(found, region, scale)
    binning, offset, expected = _reduction(info)
    if expected != source:
        raise ValueError('camera_info is of %d x %d pixels, the image has %d x %d' % (
            expected[1], expected[0], source[1], source[0]))
    if region == whole(*source) and scale == 1:
        return found
    for matrix, columns in (('K', 3), ('P', 4)):
        values = list(getattr(info, matrix))
        if values[0]:       # 0: not calibrated
            _adjust(values, columns, 0, (offset[0], binning[0], region.x, scale))
            _adjust(values, columns, 1, (offset[1], binning[1], region.y, scale))
        setattr(found, matrix, values)
    return _sized(found, region, scale)


def _reduction(info: CameraInfo) -> Tuple[Tuple[int, int], Tuple[int, int], Tuple[int, int]]:
    """What the camera itself did: (binning x, y), (offset x, y) and (height, width) of its images."""
    binning = max(1, info.binning_x), max(1, info.binning_y)
    roi, width, height = info.roi, info.width, info.height
    if roi.width and roi.height:
        width, height = roi.width, roi.height
    return binning, (roi.x_offset, roi.y_offset), (height // binning[1], width // binning[0])


def _adjust(values: List[float], columns: int, row: int, change: Tuple[int, int, int, int]) -> None:
    """Adjust a row of a camera matrix: binning as image_geometry.PinholeCameraModel, then region and scale.

    :param change: the camera's offset and binning, the region's begin, the scale
    """
    offset, binning, begin, scale = change
    for column in range(columns):
        at = row * columns + column
        if column == 2:
            values[at] = ((values[at] - offset) / binning - begin + 0.5) / scale - 0.5
        else:
            values[at] /= binning * scale


def _sized(info: CameraInfo, region: Region, scale: int) -> CameraInfo:
    info.height, info.width = -(-region.height // scale), -(-region.width // scale)
    info.binning_x = info.binning_y = 0
    info.roi = RegionOfInterest()
    return info


def image_size(info: CameraInfo) -> Tuple[int, int]:
    """(height, width) of the images that it is of [pixel]."""
    return _reduction(info)[2]
