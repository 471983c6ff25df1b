# SPDX-License-Identifier: BSD-3-Clause
"""An annotated colour image for display: with a frame, its scale, its age, and how much of it was received or how good
it is.

Nothing of the image is covered: the scale and the texts are in a strip below it. The colour of the strip and of the
frame shows the state. A frozen image is grey and has a banner across it: it must never look live. A notice, such as
EMERGENCY STOP, takes the place of the scale.
"""
import math
from dataclasses import dataclass
from typing import NamedTuple, Optional, Sequence, Tuple

import cv2
import numpy as np

from ...arrays import UInt8Array
from ...image_error import ImageError
from .colouring import MARKS, Coloured

FRESH, OLD, FROZEN = 'fresh', 'old', 'frozen'
COLOURS = {FRESH: (60, 170, 40), OLD: (0, 220, 255), FROZEN: (30, 30, 220)}
"""{state: [b, g, r]}"""
BLACK, WHITE, GREY, RED = (0, 0, 0), (255, 255, 255), (80, 80, 80), (80, 80, 255)
LEAST_WIDTH, LEAST_HEIGHT = 480, 120
"""Smaller images are enlarged and then padded, because text needs space [pixel]."""
SCALE_LEFT = 0.42
"""Where the scale begins, or a notice [width of the view]."""
OUTLINE = 90
"""The banner's dark outline is this part of the view's width: a ninetieth."""
CAPITALS = 22
"""Height of a capital letter at scale 1 [pixel], in OpenCV 4 and 5. getTextSize of 5 gives the height of a line."""
SKEW = 0.1
"""Up to this negative age is an error of the clocks [s]."""

Box = Tuple[int, int, int, int]
"""(column, row, width, height) [pixel]"""
Colour = Tuple[int, int, int]


@dataclass(frozen=True)
class Limits:
    """When an image no longer counts as live."""
    old_after: float = 0.5
    """Yellow from this age [s]."""
    frozen_after: float = 2.0
    """Red from this age, and grey [s]."""
    least_complete: float = 0.5
    """Yellow below this ratio of received pixels."""
    least_psnr: float = 20.0
    """Yellow below this ratio of an image's range to its error [dB]."""

    def state(self, age: float, good: bool) -> str:
        """FRESH, OLD or FROZEN. An age that is NaN is FROZEN, one below 0 OLD.

        :param good: whether the quality is
        """
        if not age < self.frozen_after:
            return FROZEN
        return FRESH if 0 <= age < self.old_after and good else OLD


class Layout(NamedTuple):
    """The parts of a view: a border around the image and a strip below [pixel]."""
    factor: int
    """By which the image is enlarged."""
    padding: Tuple[int, int, int, int]
    """Above, below, left, right."""
    border: int
    strip: int
    """Height of the strip."""


def layout(height: int, width: int) -> Layout:
    """The layout of the view of an image of this size."""
    factor = max(1, min(-(-LEAST_WIDTH // width), -(-LEAST_WIDTH // height)))
    rows, columns = max(0, LEAST_HEIGHT - height * factor), max(0, LEAST_WIDTH - width * factor)
    inner = width * factor + columns
    return Layout(factor, (rows // 2, rows - rows // 2, columns // 2, columns - columns // 2),
                  max(4, inner // 100), round(0.085 * inner))


class Judgement(NamedTuple):
    """Whether an image counts as live, and why not."""
    age: float
    """As it is shown [s]."""
    state: str
    """FRESH, OLD or FROZEN."""
    old: bool
    """Whether the age is a reason why it is not fresh."""
    quality: str
    """As it is shown."""
    poor: bool
    """Whether the quality is a reason."""


def judged(coloured: Coloured, age: float, completeness: float, limits: Limits, silence: float = 0.0,
           error: Optional[ImageError] = None) -> Judgement:
    """The state of an image; the arguments are those of `framed`.

    :raises ValueError: completeness is not from 0 to 1
    """
    if not 0 <= completeness <= 1:
        raise ValueError('completeness is %r, must be from 0 to 1' % completeness)
    if silence >= limits.old_after:
        age = max(silence, age)   # in this order it is silence also if age is NaN
    elif -SKEW <= age < 0:
        age = 0.0
    quality, good = _quality(coloured, completeness, error, limits)
    return Judgement(age, limits.state(age, good), not 0 <= age < limits.old_after, quality, not good)


def framed(coloured: Coloured, age: float, completeness: float, limits: Limits, silence: float = 0.0,
           error: Optional[ImageError] = None, notice: str = '', at_least: bool = False) -> UInt8Array:
    """The view: an image in a frame whose colour shows whether it is live, with its age in the strip.

    :param age: time since the image was taken [s]; below 0 if the clocks disagree; infinite: there was no image yet
    :param completeness: ratio of its pixels that were received, 0..1
    :param silence: time since it was received [s]; it is at least this old, whatever the clocks say
    :param error: of an image that was coded with loss, shown in place of the completeness
    :param notice: text in place of the scale; empty: none
    :param at_least: whether the image is older than `age`, by a time that nobody knows: the strip marks that
    :return: (height, width, 3) uint8, bgr; see layout
    :raises ValueError: completeness is not from 0 to 1
    """
    age, state, old, quality, poor = judged(coloured, age, completeness, limits, silence, error)
    place = layout(*coloured.pixels.shape[:2])
    view = _surrounded(coloured.pixels if state != FROZEN else dimmed(coloured.pixels), place, COLOURS[state])
    strip = view[-place.strip:]
    _draw_texts(strip, state, (
        ('> ' * at_least + duration(age), old),
        (quality, poor)))
    if notice:
        _draw_notice(strip[:-place.border, :-place.border], notice)
    elif coloured.palette is not None:
        _draw_scale(strip[:-place.border, :-place.border], coloured, coloured.palette, state == FROZEN)
    if state == FROZEN:
        word = 'NO DATA' if silence >= limits.old_after else 'LATE'
        _draw_banner(view[:-place.strip], 'NO DATA YET' if age == math.inf else '%s %s' % (word, duration(age)))
    return view


def titled(coloured: Coloured, title: str) -> UInt8Array:
    """An image like a view of it, grey, with a title in place of age and quality.

    :return: (height, width, 3) uint8, bgr; see layout
    """
    place = layout(*coloured.pixels.shape[:2])
    view = _surrounded(coloured.pixels, place, GREY)
    strip = view[-place.strip:-place.border, :-place.border]
    write(strip, title, (place.border, 0, int(strip.shape[1] * SCALE_LEFT) - 2 * place.border, strip.shape[0]), WHITE)
    if coloured.palette is not None:
        _draw_scale(strip, coloured, coloured.palette, False)
    return view


def _quality(coloured: Coloured, completeness: float, error: Optional[ImageError], limits: Limits) -> Tuple[str, bool]:
    """How good an image is, as a text, and whether that is good enough."""
    if error is not None:
        return str(error), error.psnr(coloured.span) >= limits.least_psnr
    return '%d %%' % math.floor(100 * completeness + 1e-6), completeness >= limits.least_complete


def duration(seconds: float) -> str:
    """A short text for a time: '0.12 s', '3.2 s', '2 min', '5 h'."""
    for most, unit, digits, name in ((1, 1, 2, 's'), (100, 1, 1, 's'), (6000, 60, 0, 'min'), (360000, 3600, 0, 'h')):
        if abs(seconds) < most:
            return '%.*f %s' % (digits, seconds / unit, name)
    return '> 99 h' if math.isfinite(seconds) else '? s'


def _surrounded(pixels: UInt8Array, place: Layout, colour: Colour) -> UInt8Array:
    """The image, enlarged and padded, with border and strip."""
    if place.factor > 1:
        pixels = cv2.resize(pixels, None, fx=place.factor, fy=place.factor, interpolation=cv2.INTER_NEAREST)
    if any(place.padding):
        above, below, left, right = place.padding
        pixels = cv2.copyMakeBorder(pixels, above, below, left, right, cv2.BORDER_CONSTANT, value=BLACK)
    view: UInt8Array = cv2.copyMakeBorder(pixels, place.border, place.strip, place.border, place.border,
                                          cv2.BORDER_CONSTANT, value=colour)
    return view


def dimmed(pixels: UInt8Array) -> UInt8Array:
    """An image as it is shown where it is frozen: grey, and darker.

    :param pixels: (height, width, 3) uint8, bgr
    """
    grey = cv2.convertScaleAbs(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), alpha=0.4, beta=30)
    found: UInt8Array = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    return found


def _draw_texts(strip: UInt8Array, state: str, texts: Sequence[Tuple[str, bool]]) -> None:
    """:param texts: (text, whether it is a reason why the view is not green)"""
    height, width = strip.shape[:2]
    pad = height // 8
    for (text, bad), left, right in zip(texts, (0.0, 0.22), (0.22, SCALE_LEFT)):
        box = int(width * left) + pad, pad, int(width * (right - left)) - 2 * pad, height - 2 * pad
        if bad:
            cv2.rectangle(strip, box, BLACK, -1)
        write(strip, text, box, BLACK if state == OLD and not bad else WHITE)


def _draw_scale(strip: UInt8Array, coloured: Coloured, palette: UInt8Array, frozen: bool) -> None:
    height, width = strip.shape[:2]
    strip[:, int(width * SCALE_LEFT):] = BLACK
    left, right, half, room = int(width * 0.46), int(width * 0.89), height // 2, int(width * 0.085)
    bar = cv2.resize(palette[np.newaxis], (right - left, half - 3), interpolation=cv2.INTER_NEAREST)
    strip[3:half, left:right] = dimmed(bar) if frozen else bar
    for middle, number in zip(np.linspace(left, right - 1, len(MARKS)).astype(int), coloured.numbers):
        strip[3:half, middle] = WHITE
        write(strip, number, (middle - room // 2, half, room, height - half), WHITE)
    write(strip, coloured.unit, (right + 6, 0, width - right - 6, half), WHITE)


def _draw_notice(strip: UInt8Array, text: str) -> None:
    height, width = strip.shape[:2]
    left = int(width * SCALE_LEFT)
    strip[:, left:] = COLOURS[FROZEN]
    lines = text.split(': ', 1)     # 'LOCKED: why' is larger on two lines
    room = height // len(lines)
    for number, line in enumerate(lines):
        write(strip, line, (left + height // 8, number * room, width - left - height // 4, room), WHITE)


def _draw_banner(image: UInt8Array, text: str) -> None:
    height, width = image.shape[:2]
    box = width // 16, (height - width // 6) // 2, width - width // 8, width // 6
    written = np.zeros((height, width), np.uint8)
    write(written, text, box, WHITE)
    reach = 2 * (width // OUTLINE) + 1
    # not by thicker strokes: OpenCV 5 has none
    image[cv2.dilate(written, np.ones((reach, reach), np.uint8)) > 127] = BLACK
    write(image, text, box, RED)


def write(image: UInt8Array, text: str, box: Box, colour: Colour) -> None:
    """Write a text in the middle of a box, as large as it fits."""
    column, row, width, height = box
    length = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 1.0, 1)[0][0]
    scale = min(0.96 * width / length, 0.55 * height / CAPITALS)
    at = int(column + (width - scale * length) / 2), int(row + (height + scale * CAPITALS) / 2)
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, max(1, round(2 * scale)), cv2.LINE_AA)
