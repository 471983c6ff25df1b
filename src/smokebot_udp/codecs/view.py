# SPDX-License-Identifier: BSD-3-Clause
"""A picture for the operator's eyes: in 8-bit colours, with how old it is and how much of it was received.

Nothing of the picture is covered: a strip below it has the scale of the palette and the words, and its colour and
the frame's tell the state. What is frozen is grey and crossed by words: it must never look live.
"""
import cv2
import numpy as np

FRESH, OLD, FROZEN = 'fresh', 'old', 'frozen'
COLOURS = {FRESH: (60, 150, 60), OLD: (0, 200, 230), FROZEN: (40, 40, 220)}
"""{state: (b, g, r)}"""

PALETTES = {'inferno': cv2.COLORMAP_INFERNO, 'jet': cv2.COLORMAP_JET, 'hot': cv2.COLORMAP_HOT,
            'bone': cv2.COLORMAP_BONE, 'magma': cv2.COLORMAP_MAGMA, 'viridis': cv2.COLORMAP_VIRIDIS}
DARKEST, BRIGHTEST = 1.0, 97.0
"""Automatic range: these percentiles of a picture; a fire is brighter, and must not take all of the palette."""

FOLLOWS = 0.2
"""So much of a change the automatic range takes at once: it must not flicker."""

LEAST_SPAN = 1e-3

ROOM_FOR_SCALE = 320
"""Narrower pictures have no room for a scale beside the words [pixel]."""
FEW = 0.3
"""A picture of which less was received counts as old: its details are guesses."""


def state_of(age, completeness, old_after, frozen_after):
    """FRESH, OLD or FROZEN of a picture's age [s] and the share of it that was received."""
    if not age < frozen_after:
        return FROZEN
    return OLD if age >= old_after or completeness < FEW else FRESH


class View:
    """Renders the pictures of one stream.

    :param palette: one of PALETTES, for pictures of one channel with more than 8 bits
    :param low, high: of the palette, in units; equal: automatic
    :param per_unit, zero: a pixel's value is value / per_unit + zero in units
    :param unit: its name, below the scale
    """

    def __init__(self, palette='inferno', low=0.0, high=0.0, per_unit=1.0, zero=0.0, unit=''):
        self.palette, self.fixed = PALETTES[palette], (low, high) if low < high else None
        self.per_unit, self.zero, self.unit = per_unit, zero, unit
        self._range = None

    def render(self, pixels, encoding, age, completeness, state):
        """One picture.

        :param pixels: (height, width) or (height, width, channels) array, see pixels.as_pixels
        :param age: [s]; completeness: 0..1; state: of state_of
        :return: (height + strip, width, 3) uint8, bgr
        """
        scale = None
        if pixels.ndim == 3:
            colours = pixels[..., :3] if encoding.startswith(('bgr', '8UC')) else pixels[..., 2::-1]
        elif pixels.dtype == np.uint8:
            colours = np.repeat(pixels[..., np.newaxis], 3, axis=2)
        else:
            scale = self._range_of(pixels)
            colours = cv2.applyColorMap(_to_bytes(pixels, *self._in_counts(scale)), self.palette)
        picture = np.ascontiguousarray(colours)
        if state == FROZEN:
            picture = (picture.mean(axis=2, keepdims=True) * 0.4).astype(np.uint8).repeat(3, axis=2)
            _across(picture, 'NO DATA %s' % seconds(age))
        elif picture is pixels or picture.base is not None:
            picture = picture.copy()
        cv2.rectangle(picture, (0, 0), (picture.shape[1] - 1, picture.shape[0] - 1), COLOURS[state],
                      max(1, picture.shape[1] // 160))
        return np.vstack([picture, self._strip(picture.shape[1], scale, age, completeness, state)])

    def _range_of(self, pixels):
        """(low, high) of the palette in units."""
        if self.fixed:
            return self.fixed
        step = max(1, int(np.sqrt(pixels.size / 5000)))
        some = pixels[::step, ::step].astype(np.float64)
        some = some[np.isfinite(some)]
        low, high = np.percentile(some, (DARKEST, BRIGHTEST)) if len(some) else (0.0, 1.0)
        seen = np.array([low, max(high, low + LEAST_SPAN)]) / self.per_unit + self.zero
        self._range = seen if self._range is None else self._range + FOLLOWS * (seen - self._range)
        return tuple(self._range)

    def _in_counts(self, scale):
        return tuple((value - self.zero) * self.per_unit for value in scale)

    def _strip(self, width, scale, age, completeness, state):
        height = max(12, width // 20)
        strip = np.full((height, width, 3), COLOURS[state], np.uint8)
        words = '%s  %d %%' % (seconds(age), round(100 * completeness))
        ink = (30, 30, 30) if state == OLD else (255, 255, 255)
        _write(strip, words, width - 4, ink, right=True)
        if scale is not None and width >= ROOM_FOR_SCALE:
            low, high = ('%.0f' % value for value in scale)
            begin = 4 + _write(strip, low, 4, ink) + 4
            end = begin + width // 4
            ramp = np.linspace(0, 255, end - begin).astype(np.uint8)[np.newaxis]
            strip[3:-3, begin:end] = cv2.applyColorMap(ramp, self.palette)
            _write(strip, high + ' ' + self.unit, end + 4, ink)
        return strip


def seconds(age):
    """An age in few letters."""
    return '%.2f s' % age if age < 10 else '%.0f s' % age if age < 600 else '%.0f min' % (age / 60)


def _to_bytes(pixels, low, high):
    """(height, width) uint8: low becomes 0, high 255."""
    factor = 255.0 / max(high - low, 1e-9)
    if pixels.dtype.kind == 'u':    # one look-up is faster than the reckoning
        table = np.clip((np.arange(65536) - low) * factor, 0, 255).astype(np.uint8)
        return table[pixels]
    with np.errstate(invalid='ignore', over='ignore'):
        return np.nan_to_num(np.clip((pixels.astype(np.float32) - low) * factor, 0, 255)).astype(np.uint8)


def _font(height):
    return cv2.FONT_HERSHEY_SIMPLEX, height / 32.0, max(1, height // 16)


def _write(strip, words, column, ink, right=False):
    """Write into a strip; returns how wide it is [pixel]."""
    face, size, thickness = _font(strip.shape[0])
    (width, height), _ = cv2.getTextSize(words, face, size, thickness)
    at = column - width if right else column, (strip.shape[0] + height) // 2
    cv2.putText(strip, words, at, face, size, ink, thickness, cv2.LINE_AA)
    return width


def _across(picture, words):
    """Large words across the middle."""
    face, size, thickness = _font(max(16, picture.shape[1] // 8))
    (width, height), _ = cv2.getTextSize(words, face, size, thickness)
    size *= min(1.0, 0.9 * picture.shape[1] / width)
    (width, height), _ = cv2.getTextSize(words, face, size, thickness)
    at = (picture.shape[1] - width) // 2, (picture.shape[0] + height) // 2
    cv2.putText(picture, words, at, face, size, COLOURS[FROZEN], thickness, cv2.LINE_AA)
