# SPDX-License-Identifier: BSD-3-Clause
"""The pictures of an image stream as JPEG, in the few sizes that browsers ask for, each encoded once."""
import math
from typing import Any, Dict, Iterable, Mapping, NamedTuple, Optional

import cv2
import numpy as np

from ..arrays import UInt8Array
from .frames import finite

WIDTHS = (160, 240, 320, 480, 640, 960, 1280, 1920)
"""Widths of the JPEGs [pixel]: a browser gets the next wider one, but never more pixels than the picture has."""

QUALITY = 80
"""Quality of the JPEGs, 0..100."""

MAX_PIXELS = 4096 * 4096
"""Larger pictures are not shown."""


DIGITS = 6
"""Digits after the point of the numbers of a picture."""


class Picture(NamedTuple):
    """A picture and what is known of it."""
    pixels: UInt8Array
    """(height, width, 3) uint8, bgr"""
    stamp: float
    """By the robot's clock [s]."""
    came: float
    """By a steady clock [s]."""
    age: float
    """When it came [s]; infinite: there was no image yet."""
    fields: Mapping[str, Any]
    """Further metadata, as in doc/web_protocol.md."""
    values: Mapping[str, Any] = {}
    """counts_per_unit, zero, unit: of the original's pixels."""


def picture_of(message: Any, came: float) -> Picture:
    """The picture of a ViewImage.

    :param came: by a steady clock [s]
    :raises ValueError: it contradicts itself
    """
    height, width = message.height, message.width
    if not (height and width) or height * width > MAX_PIXELS or len(message.data) != 3 * height * width:
        raise ValueError('a picture of %d x %d pixels in %d bytes' % (width, height, len(message.data)))
    pixels = np.frombuffer(message.data, np.uint8).reshape(height, width, 3)
    fields = {
        'at_least': bool(message.at_least), 'state': message.state,
        'reason': 'age' if message.old else 'quality' if message.poor else '', 'quality': message.quality,
        'completeness': finite(message.completeness, DIGITS), 'error': finite(message.error, DIGITS),
        'old_after': finite(message.old_after, DIGITS), 'frozen_after': finite(message.frozen_after, DIGITS),
        'full_width': width, 'full_height': height, 'scale': scale_of(message), 'notice': message.notice}
    values = {name: getattr(message, name) for name in ('counts_per_unit', 'zero', 'unit')}
    return Picture(pixels, message.header.stamp.to_sec(), came, message.age, fields, values)


def scale_of(message: Any) -> Optional[Mapping[str, Any]]:
    """The scale of a ViewImage; None: it has none."""
    if not message.numbers or not message.palette:
        return None
    palette = np.frombuffer(message.palette, np.uint8)
    colours = palette[:len(palette) // 3 * 3].reshape(-1, 3)[:, ::-1].tolist()
    return {'numbers': list(message.numbers), 'unit': message.unit,
            'colours': ['#%02x%02x%02x' % tuple(colour) for colour in colours]}


def step_of(width: int) -> int:
    """The width that is encoded for a browser that asks for this one [pixel]."""
    return next((step for step in WIDTHS if step >= width), WIDTHS[-1])


def jpeg(pixels: UInt8Array, width: int) -> 'Encoded':
    """A picture as JPEG, at most `width` pixels wide."""
    if pixels.shape[1] > width:
        height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
        pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode('.jpg', pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise ValueError('a picture of %d x %d pixels cannot be encoded' % (pixels.shape[1], pixels.shape[0]))
    return Encoded(data.tobytes(), pixels.shape[1], pixels.shape[0])


class Encoded(NamedTuple):
    """A JPEG."""
    data: bytes
    width: int
    height: int


class Current(NamedTuple):
    """A picture, encoded."""
    number: int
    """How many there were."""
    picture: Picture
    encoded: Mapping[int, Encoded]
    """By step of the width."""


class Pictures:
    """The newest picture of one stream. A thread encodes it, others read; what it holds is replaced, not changed."""

    def __init__(self) -> None:
        self.newest: Optional[Picture] = None
        """That came."""
        self.current: Optional[Current] = None
        """That was encoded last."""

    def encode(self, widths: Iterable[int]) -> bool:
        """Encode the newest picture where it is new, in these widths; returns whether there is anything new.

        Of a picture that comes again, as that of a frozen stream, only the widths that are missing are encoded.
        """
        picture, steps = self.newest, {step_of(width) for width in widths}
        before = self.current
        if picture is None or not steps or (
                before is not None and picture is before.picture and steps <= before.encoded.keys()):
            return False
        old: Mapping[int, Encoded] = {}
        if before is not None and (picture is before.picture or _same(picture, before.picture)):
            old = before.encoded
        encoded = {step: old.get(step) or jpeg(picture.pixels, step) for step in steps}
        self.current = Current(before.number + 1 if before else 1, picture, encoded)
        return True


def metadata(picture: Picture, encoded: Encoded, now: float, clock: float) -> Dict[str, Any]:
    """The metadata of an image that is sent now.

    :param now: by a steady clock [s]
    :param clock: Unix time [s]
    """
    age = picture.age + now - picture.came
    return {'stamp': picture.stamp, 'age': round(age, 4) if math.isfinite(age) else None, **picture.fields,
            'width': encoded.width, 'height': encoded.height, 'sent': clock}


def _same(one: Picture, other: Picture) -> bool:
    return one.pixels.shape == other.pixels.shape and one.stamp == other.stamp and np.array_equal(
        one.pixels, other.pixels)
