# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of 8 bits and of more in colours for eyes, with the scale of the palette."""
import math
from dataclasses import dataclass
from typing import Optional, Tuple

import cv2
import numpy as np

PALETTES = ('inferno', 'hot', 'jet', 'turbo', 'gray', 'bone', 'rainbow', 'magma', 'plasma', 'viridis', 'cividis')
"""Those of OpenCV's colour maps that make a scale, as far as OpenCV 4.2 of Ubuntu 20.04 has them, and gray."""
PLAIN = {'mono8': cv2.COLOR_GRAY2BGR, '8UC1': cv2.COLOR_GRAY2BGR, 'bgr8': None, '8UC3': None,
         'rgb8': cv2.COLOR_RGB2BGR, 'bgra8': cv2.COLOR_BGRA2BGR, '8UC4': cv2.COLOR_BGRA2BGR,
         'rgba8': cv2.COLOR_RGBA2BGR}
"""{encoding: how it becomes bgr8}: pictures that are shown as they are."""
SCALED = 'mono16', '16UC1', '32FC1'   # encodings that need a palette
NO_READING = 90, 80, 80   # [b, g, r]: 0 of 16 bits, NaN, an infinity; no palette but gray comes near it
SHADES = 254   # of a palette: 2 of the 256 colours that a table can tell apart are NO_READING
MARKS = np.linspace(0.0, 1.0, 5)   # where the scale has its numbers, as shares of the palette

KNEE = 0.75
"""The share of the palette that is kept for what is not exceptionally hot."""
CLIMB = 5.0
"""Hot begins where, of one of LEVELS to the next, what lies above the coldest grows more than so many times."""
LEVELS = 1, 50, 60, 70, 80, 90, 95, 98   # [percent]: a fire may fill half the picture, and its coldest are robust
MIDDLE = 0.35, 0.5
"""Between these shares lies the median: neither the colder nor the warmer half of a picture is without contrast."""
SETTLING = 0.7   # [s] until the automatic range has followed the scene by two thirds
LEAST_SPAN = 0.005   # of a value: cameras hardly are more exact
SAMPLES = 20000   # pixels that quantiles are taken of


@dataclass(frozen=True)
class Coloured:
    """A picture in colours."""
    pixels: np.ndarray
    """(height, width, 3) uint8, bgr"""
    palette: Optional[np.ndarray] = None
    """(SHADES, 3) uint8, bgr; None where there is no scale."""
    numbers: Tuple[str, ...] = ()
    """What the shades at MARKS mean."""
    unit: str = ''


class Colouring:
    """Turns the pictures of one source into colours.

    A fixed range is spread evenly over the palette. An automatic one follows the scene; where a few things are much
    hotter than all others, the palette's last quarter is theirs, up to the hottest pixel, so that they stand out
    from each other and take no contrast from the rest. The scale's numbers tell.

    :param palette: one of PALETTES
    :param low, high: what gets the palette's first and last colour [unit]; not rising: automatic
    :param counts_per_unit, zero: a pixel's value / counts_per_unit + zero is in units
    :param unit: its name, beside the scale
    :raises ValueError: where palette or counts_per_unit is wrong
    """

    def __init__(self, palette='inferno', low=0.0, high=0.0, counts_per_unit=1.0, zero=0.0, unit='counts'):
        if palette not in PALETTES:
            raise ValueError('palette is %r, must be one of %s' % (palette, ', '.join(PALETTES)))
        if not counts_per_unit > 0:
            raise ValueError('counts_per_unit is %r, must be above 0' % counts_per_unit)
        self.unit, self._per_unit, self._zero = unit, counts_per_unit, zero
        self._automatic = AutomaticRange()
        self._fixed = None
        if low < high:
            self._fixed = tuple((value - zero) * counts_per_unit for value in (low, high)), (0.0, 1.0)
        shades = np.rint(np.linspace(0, 255, SHADES)).astype(np.uint8)[:, np.newaxis]
        self._palette = np.repeat(shades, 3, axis=1) if palette == 'gray' else cv2.applyColorMap(
            shades, getattr(cv2, 'COLORMAP_' + palette.upper()))[:, 0]
        self._colours = np.concatenate([np.uint8([NO_READING] * 2), self._palette])[:, np.newaxis]

    def __call__(self, pixels, encoding, time):
        """Colour a picture.

        :param pixels: (height, width) or (height, width, channels) array, in any byte order, see pixels.as_pixels
        :param encoding: as in sensor_msgs/Image
        :param time: of any clock, by which an automatic range is smoothed [s]
        :return: Coloured
        :raises ValueError: where the encoding is neither of PLAIN nor SCALED
        """
        native = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('='))
        if encoding in PLAIN:
            how = PLAIN[encoding]
            return Coloured(native if how is None else cv2.cvtColor(native, how))
        if encoding not in SCALED:
            raise ValueError('encoding is %r, must be one of %s' % (encoding, ', '.join((*PLAIN, *SCALED))))
        values, shares = self._fixed or self._automatic.follow(native, time)
        places = values
        if encoding == '32FC1':
            native, places = _codes(native, values)
        index = (np.interp(np.arange(65536), places, shares) * (SHADES - 1) + 2.5).astype(np.uint8)
        index[0] = 0
        marks = numbers(np.interp(MARKS, shares, values) / self._per_unit + self._zero)
        return Coloured(cv2.applyColorMap(np.take(index, native), self._colours), self._palette, marks, self.unit)


class AutomaticRange:
    """Follows what a scene's values span, without flicker."""

    def __init__(self):
        self._smooth = self._time = None

    def follow(self, pixels, time):
        """The range for a picture.

        :param pixels: (height, width) uint16 or float32
        :param time: [s]; where it goes back, the range begins anew
        :return: (values, shares), 4 floats each, rising: the coldest, the median, where the hot begins, the hottest
        """
        target = self._target(pixels)
        if target is None:
            target = np.float64([0, 0, 1, 1]) if self._smooth is None else self._smooth
        if self._smooth is None or not time >= self._time:
            self._smooth = target
        else:
            self._smooth = self._smooth + (target - self._smooth) * -math.expm1((self._time - time) / SETTLING)
        self._time = time
        low, middle, knee, top = self._smooth
        share = max(KNEE, (knee - low) / (top - low))
        even = share * (middle - low) / (knee - low)
        half = min(max(even, min(MIDDLE[0], (middle - low) / _least_span(middle))), MIDDLE[1])
        return self._smooth, (0.0, half, share, 1.0)

    def _target(self, pixels):
        """(4,) float64 for this picture alone; None where it has no value at all."""
        every = max(1, int(math.sqrt(pixels.size / SAMPLES)))
        sample = pixels[::every, ::every]
        sample = sample[np.isfinite(sample) if pixels.dtype.kind == 'f' else sample > 0].astype(float)
        if not sample.size:
            return None
        low, middle, *levels = np.percentile(sample, LEVELS)
        # of all pixels: the smallest fire matters
        top = float(pixels.max(initial=low, where=np.isfinite(pixels)) if pixels.dtype.kind == 'f' else pixels.max())
        least = _least_span(middle)
        knee = max(low + least, middle + least / 2)
        for level in levels:
            if level - low > CLIMB * (knee - low):
                break
            knee = max(knee, level)
        return np.float64([low, middle, knee, max(top, knee)])


def _least_span(value):
    """What a good part of the palette spans at least, lest it shows noise: 1.5 K where values rise from 0 K."""
    return max(LEAST_SPAN * abs(value), 1e-6)


def _codes(pixels, values):
    """float32 (height, width) as uint16, 0 where there is no number, and where rising values (n,) lie in it."""
    low, top = values[0], values[-1]
    with np.errstate(over='ignore', invalid='ignore'):
        scaled = (pixels - np.float32(low)) * np.float32(65534 / (top - low))
    codes = np.where(np.isfinite(pixels), np.clip(scaled, 0, 65534) + 1, 0).astype(np.uint16)
    return codes, np.interp(values, (low, top), (1, 65535))


def numbers(values):
    """Texts of rising numbers (n,), each with as many digits as tell it from its neighbours."""
    steps = np.diff(values)
    steps = np.minimum(np.append(steps, steps[-1]), np.append(steps[0], steps))
    digits = [min(max(-math.floor(math.log10(step)), 0), 4) if step > 0 else 0 for step in steps]
    return tuple('%.*f' % (few, value) if abs(value) < 1e5 else '%.2g' % value for few, value in zip(digits, values))
