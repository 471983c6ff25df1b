# SPDX-License-Identifier: BSD-3-Clause
"""A picture for an operator's eyes: framed, with its scale, its age, and how much of it was received.

Nothing of the picture is covered: a strip below it has the scale and the words, and its colour and the frame's tell
the state. What is frozen is grey and crossed by words: it must never look live.
"""
import math
from dataclasses import dataclass
from typing import NamedTuple, Tuple

import cv2
import numpy as np

from .colouring import MARKS

FRESH, OLD, FROZEN = 'fresh', 'old', 'frozen'
COLOURS = {FRESH: (60, 170, 40), OLD: (0, 220, 255), FROZEN: (30, 30, 220)}   # {state: [b, g, r]}
BLACK, WHITE = (0, 0, 0), (255, 255, 255)
LEAST_WIDTH, LEAST_HEIGHT = 480, 120   # [pixel]; smaller pictures are enlarged and then padded: text needs room
SKEW = 0.1   # so much a picture may seem to come from the future [s]: clocks hardly agree better


@dataclass(frozen=True)
class Limits:
    """When a picture no longer passes for a live one."""
    old_after: float = 0.5        # yellow from this age [s]
    frozen_after: float = 2.0     # red from this age, and without its colours [s]
    least_complete: float = 0.5   # yellow below this share of received pixels

    def state(self, age, completeness):
        """FRESH, OLD or FROZEN; so is an age that is not a number, while one from the future is OLD."""
        if not age < self.frozen_after:
            return FROZEN
        return FRESH if 0 <= age < self.old_after and completeness >= self.least_complete else OLD


class Layout(NamedTuple):
    """Where everything lies in a view [pixel]: a border around the picture, a strip below, and nothing covered."""
    factor: int   # by which the picture is enlarged
    padding: Tuple[int, int, int, int]   # above, below, left, right
    border: int
    strip: int   # its height


def layout(height, width):
    """The Layout of a picture's view."""
    factor = max(1, min(-(-LEAST_WIDTH // width), -(-LEAST_WIDTH // height)))
    rows, columns = max(0, LEAST_HEIGHT - height * factor), max(0, LEAST_WIDTH - width * factor)
    inner = width * factor + columns
    return Layout(factor, (rows // 2, rows - rows // 2, columns // 2, columns - columns // 2),
                  max(4, inner // 100), round(0.085 * inner))


def framed(coloured, age, completeness, limits, silence=0.0):
    """The view: a picture in a frame that tells by its colour whether it is live, and in its strip how old it is.

    :param coloured: Coloured
    :param age: since the picture was taken [s]; below 0 where the clocks disagree; infinite: there never was one
    :param completeness: share of its pixels that were received, 0..1
    :param limits: Limits
    :param silence: since it came [s]; so old it is at least, whatever the clocks say
    :return: (height, width, 3) uint8, bgr; see layout
    :raises ValueError: where completeness is not from 0 to 1
    """
    if not 0 <= completeness <= 1:
        raise ValueError('completeness is %r, must be from 0 to 1' % completeness)
    if silence >= limits.old_after:
        age = max(silence, age)   # in this order it is silence also where age is not a number
    elif -SKEW <= age < 0:
        age = 0.0
    state = limits.state(age, completeness)
    place = layout(*coloured.pixels.shape[:2])
    pixels = coloured.pixels if state != FROZEN else _dimmed(coloured.pixels)
    if place.factor > 1:
        pixels = cv2.resize(pixels, None, fx=place.factor, fy=place.factor, interpolation=cv2.INTER_NEAREST)
    if any(place.padding):
        pixels = cv2.copyMakeBorder(pixels, *place.padding, cv2.BORDER_CONSTANT, value=BLACK)
    view = cv2.copyMakeBorder(pixels, place.border, place.strip, place.border, place.border, cv2.BORDER_CONSTANT,
                              value=COLOURS[state])
    strip = view[-place.strip:]
    _draw_texts(strip, state, (
        (duration(age), not 0 <= age < limits.old_after),
        ('%d %%' % math.floor(100 * completeness + 1e-6), completeness < limits.least_complete)))
    if coloured.palette is not None:
        _draw_scale(strip[:-place.border, :-place.border], coloured, state == FROZEN)
    if state == FROZEN:
        word = 'NO DATA' if silence >= limits.old_after else 'LATE'
        _draw_banner(view[:-place.strip], 'NO DATA YET' if age == math.inf else '%s %s' % (word, duration(age)))
    return view


def duration(seconds):
    """A time as short as it can be read: '0.12 s', '3.2 s', '2 min', '5 h'."""
    for most, unit, digits, name in ((1, 1, 2, 's'), (100, 1, 1, 's'), (6000, 60, 0, 'min'), (360000, 3600, 0, 'h')):
        if abs(seconds) < most:
            return '%.*f %s' % (digits, seconds / unit, name)
    return '> 99 h' if math.isfinite(seconds) else '? s'


def _dimmed(pixels):
    grey = cv2.convertScaleAbs(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), alpha=0.4, beta=30)
    return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)


def _draw_texts(strip, state, texts):
    height, width = strip.shape[:2]
    pad = height // 8
    for (text, bad), left, right in zip(texts, (0.0, 0.22), (0.22, 0.42)):   # bad: why the view is not green
        box = int(width * left) + pad, pad, int(width * (right - left)) - 2 * pad, height - 2 * pad
        if bad:
            cv2.rectangle(strip, box, BLACK, -1)
        _write(strip, text, box, BLACK if state == OLD and not bad else WHITE)


def _draw_scale(strip, coloured, dimmed):
    height, width = strip.shape[:2]
    strip[:, int(width * 0.42):] = BLACK
    left, right, half, room = int(width * 0.46), int(width * 0.89), height // 2, int(width * 0.1)
    bar = cv2.resize(coloured.palette[np.newaxis], (right - left, half - 3), interpolation=cv2.INTER_NEAREST)
    strip[3:half, left:right] = _dimmed(bar) if dimmed else bar
    for middle, number in zip(np.linspace(left, right - 1, len(MARKS)).astype(int), coloured.numbers):
        strip[3:half, middle] = WHITE
        _write(strip, number, (middle - room // 2, half, room, height - half), WHITE)
    _write(strip, coloured.unit, (right + 6, 0, width - right - 6, half), WHITE)


def _draw_banner(picture, text):
    height, width = picture.shape[:2]
    box = width // 16, (height - width // 6) // 2, width - width // 8, width // 6
    _write(picture, text, box, BLACK, 4)
    _write(picture, text, box, (80, 80, 255))


def _write(image, text, box, ink, boldness=1):
    """Text as large as fits into the middle of a box (column, row, width, height)."""
    column, row, width, height = box
    (length, up), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 1.0, 1)
    scale = min(0.96 * width / length, 0.55 * height / up)
    at = int(column + (width - scale * length) / 2), int(row + (height + scale * up) / 2)
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, ink, max(1, round(2 * scale)) * boldness,
                cv2.LINE_AA)
