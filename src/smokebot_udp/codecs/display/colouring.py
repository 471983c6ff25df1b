# SPDX-License-Identifier: BSD-3-Clause
"""Images of any encoding in colours for display, with the scale of the palette."""
import math
from dataclasses import dataclass
from typing import Optional, Tuple

import cv2
import numpy as np

from ...arrays import Array, FloatArray, UInt8Array
from ...image_error import EIGHT_BITS
from ..wire.bayer import BAYER, debayered

PALETTES = ('inferno', 'hot', 'jet', 'turbo', 'gray', 'bone', 'rainbow', 'magma', 'plasma', 'viridis', 'cividis')
"""The colour maps of OpenCV 4.2 (Ubuntu 20.04) that are suitable for a scale, and gray."""
PLAIN = {'mono8': cv2.COLOR_GRAY2BGR, '8UC1': cv2.COLOR_GRAY2BGR, 'bgr8': None, '8UC3': None,
         'rgb8': cv2.COLOR_RGB2BGR, 'bgra8': cv2.COLOR_BGRA2BGR, '8UC4': cv2.COLOR_BGRA2BGR,
         'rgba8': cv2.COLOR_RGBA2BGR}
"""{encoding: OpenCV's conversion to bgr8, None: none}: these images are shown as they are."""
SCALED = 'mono16', '16UC1', '32FC1'
"""Encodings that need a palette."""
NO_READING = 90, 80, 80
"""Colour of 0 in 16 bits, of NaN and of infinities [b, g, r]; no palette but gray has a similar one."""
SHADES = 254
"""Number of colours of a palette: OpenCV's colour table has 256 entries, and 2 of them are NO_READING."""
MARKS = np.linspace(0.0, 1.0, 5)
"""Positions of the scale's numbers, as ratios of the palette."""

KNEE = 0.75
"""Ratio of the palette that is reserved for all but the exceptionally hot values."""
CLIMB = 5.0
"""Hot begins at the percentile of LEVELS after which the distance from the coldest grows by more than this factor."""
LEVELS = 1, 50, 60, 70, 80, 90, 95, 98
"""Percentiles that are examined [percent]: a fire may fill half the image, and the first is robust against single cold
pixels."""
MIDDLE = 0.35, 0.5
"""The median is between these ratios of the palette, so both halves of the image have contrast."""
SETTLING = 0.7
"""Time constant of the automatic range [s]."""
LEAST_SPAN = 0.005
"""Ratio of a value: no camera is much more accurate."""
SAMPLES = 20000
"""Number of pixels that percentiles are calculated from."""


@dataclass(frozen=True)
class Coloured:
    """An image in colours."""
    pixels: UInt8Array
    """(height, width, 3) uint8, bgr"""
    palette: Optional[UInt8Array] = None
    """(SHADES, 3) uint8, bgr; None: there is no scale."""
    numbers: Tuple[str, ...] = ()
    """The values of the shades at MARKS."""
    unit: str = ''
    span: float = EIGHT_BITS
    """Range of the pixels' values that the colours show."""


class Colouring:
    """Converts the images of one source to colours.

    A fixed range is spread evenly over the palette. An automatic range follows the scene. If few things are much hotter
    than all others, such as a fire, the last quarter of the palette is reserved for them, up to the hottest pixel: they
    are distinguishable from each other and do not wash out the rest. The scale's numbers show this.

    :param palette: one of PALETTES
    :param low, high: values of the palette's first and last colour [unit]; if low >= high, the range is automatic
    :param counts_per_unit, zero: value [unit] = pixel / counts_per_unit + zero
    :param unit: its name, shown beside the scale
    :param automatic: of a Colouring that this one replaces, whose automatic range goes on
    :raises ValueError: palette or counts_per_unit is wrong
    """

    def __init__(self, palette: str = 'inferno', low: float = 0.0, high: float = 0.0, counts_per_unit: float = 1.0,
                 zero: float = 0.0, unit: str = 'counts', automatic: Optional['AutomaticRange'] = None) -> None:
        if palette not in PALETTES:
            raise ValueError('palette is %r, must be one of %s' % (palette, ', '.join(PALETTES)))
        if not counts_per_unit > 0:
            raise ValueError('counts_per_unit is %r, must be above 0' % counts_per_unit)
        self.unit, self._per_unit, self._zero = unit, counts_per_unit, zero
        self.automatic = automatic or AutomaticRange()
        """The state of the automatic range."""
        self._fixed: Optional[Tuple[FloatArray, FloatArray]] = None
        if low < high:
            self._fixed = (np.array([low, high]) - zero) * counts_per_unit, np.array([0.0, 1.0])
        shades = np.rint(np.linspace(0, 255, SHADES)).astype(np.uint8)[:, np.newaxis]
        self._palette: UInt8Array = np.repeat(shades, 3, axis=1) if palette == 'gray' else cv2.applyColorMap(
            shades, getattr(cv2, 'COLORMAP_' + palette.upper()))[:, 0]
        self._colours = np.concatenate([np.array([NO_READING] * 2, np.uint8), self._palette])[:, np.newaxis]

    def __call__(self, pixels: Array, encoding: str, time: float) -> Coloured:
        """Colour an image.

        :param pixels: (height, width) or (height, width, channels) array, in any byte order, see pixels.as_pixels
        :param encoding: as in sensor_msgs/Image
        :param time: by any clock; an automatic range is smoothed over it [s]
        :raises ValueError: the encoding is none of PLAIN, SCALED and mosaics
        """
        native = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('='))
        if encoding in PLAIN:
            conversion = PLAIN[encoding]
            return Coloured(native if conversion is None else cv2.cvtColor(native, conversion))
        if encoding in BAYER:
            return Coloured(debayered(native, encoding))
        if encoding not in SCALED:
            raise ValueError('encoding is %r, must be one of %s' % (encoding, ', '.join((*PLAIN, *SCALED))))
        values, ratios = self._fixed or self.automatic.follow(native, time)
        codes, places = (native, values) if encoding != '32FC1' else _codes(native, values)
        index = (np.interp(np.arange(65536), places, ratios) * (SHADES - 1) + 2.5).astype(np.uint8)
        index[0] = 0
        marks = numbers(np.interp(MARKS, ratios, values) / self._per_unit + self._zero)
        return Coloured(cv2.applyColorMap(np.take(index, codes), self._colours), self._palette, marks, self.unit,
                        float(values[-1] - values[0]))


class AutomaticRange:
    """A range that follows a scene's values without flicker."""

    def __init__(self) -> None:
        self._smooth: Optional[FloatArray] = None
        self._time = -math.inf

    def follow(self, pixels: Array, time: float) -> Tuple[FloatArray, FloatArray]:
        """The range for an image.

        :param pixels: (height, width) uint16 or float32
        :param time: if it goes back, the range begins anew [s]
        :return: values and their ratios of the palette, (4,) float64 each, ascending: the coldest, the median, where
            hot begins, the hottest
        """
        target = self._target(pixels)
        if target is None:
            target = np.array([0.0, 0.0, 1.0, 1.0]) if self._smooth is None else self._smooth
        if self._smooth is None or not time >= self._time:
            self._smooth = target
        else:
            self._smooth = self._smooth + (target - self._smooth) * -math.expm1((self._time - time) / SETTLING)
        self._time = time
        low, middle, knee, top = self._smooth
        hot = max(KNEE, (knee - low) / (top - low))
        even = hot * (middle - low) / (knee - low)
        half = min(max(even, min(MIDDLE[0], (middle - low) / _least_span(middle))), MIDDLE[1])
        return self._smooth, np.array([0.0, half, hot, 1.0])

    def _target(self, pixels: Array) -> Optional[FloatArray]:
        """(4,) float64 for this image alone; None if it has no value at all."""
        every = max(1, int(math.sqrt(pixels.size / SAMPLES)))
        sample = pixels[::every, ::every]
        sample = sample[np.isfinite(sample) if pixels.dtype.kind == 'f' else sample > 0]
        if not sample.size:
            return None
        sample.sort(kind='stable')      # of 16 bits by radix: np.percentile takes four times as long
        low, middle, *levels = np.interp(np.multiply(LEVELS, (sample.size - 1) / 100), np.arange(sample.size), sample)
        # of all pixels: the smallest fire matters
        top = float(pixels.max(initial=low, where=np.isfinite(pixels)) if pixels.dtype.kind == 'f' else pixels.max())
        least = _least_span(middle)
        knee = max(low + least, middle + least / 2)
        for level in levels:
            if level - low > CLIMB * (knee - low):
                break
            knee = max(knee, level)
        return np.array([low, middle, knee, max(top, knee)])


def _least_span(value: float) -> float:
    """The least span of a good part of the palette, so that it does not show noise: 1.5 K if 0 is 0 K."""
    return max(LEAST_SPAN * abs(value), 1e-6)


def _codes(pixels: Array, values: FloatArray) -> Tuple[Array, FloatArray]:
    """Floats in 16 bits.

    :param pixels: (height, width) float32
    :param values: (n,) ascending: the first and the last are the range
    :return: (height, width) uint16, 0 where a pixel is not finite, and the codes of the values
    """
    low, top = values[0], values[-1]
    with np.errstate(over='ignore', invalid='ignore'):
        scaled = (pixels - np.float32(low)) * np.float32(65534 / (top - low))
    codes = np.where(np.isfinite(pixels), np.clip(scaled, 0, 65534) + 1, 0).astype(np.uint16)
    return codes, np.interp(values, (low, top), (1, 65535))


def numbers(values: FloatArray) -> Tuple[str, ...]:
    """(n,) ascending numbers as texts, each with the fewest digits that distinguish it from its neighbours."""
    steps = np.diff(values)
    steps = np.minimum(np.append(steps, steps[-1]), np.append(steps[0], steps))
    return tuple(map(_number, values.tolist(), steps.tolist()))


def _number(value: float, step: float) -> str:
    """A number as text, with the digits that distinguish it from one that is a step away."""
    place = math.floor(math.log10(step)) if step > 0 else 0
    text = '%.*f' % (min(max(-place, 0), 4), value)
    if abs(value) < 1e5 or len(text) <= 7:
        return text
    return '%.*g' % (min(max(math.floor(math.log10(abs(value))) - place + 1, 2), 9), value)
