# SPDX-License-Identifier: BSD-3-Clause
"""Pixels to channels and back: YCoCg-R of colours (Malvar, Sullivan 2003), reversible of integers."""
from typing import Any, List

import numpy as np

from ...arrays import Array
from .loops import compiled, float32, int32

HALF = float32(0.5)


@compiled
def _grey(pixels: Array, offset: int, result: Array) -> None:
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            result[y, x] = int32(pixels[y, x]) - int32(offset)


@compiled
def _split_colours(pixels: Array, offset: int, luma: Array, orange: Array, green: Array) -> None:
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            b, g, r = int32(pixels[y, x, 0]), int32(pixels[y, x, 1]), int32(pixels[y, x, 2])
            co = r - b
            t = b + (co >> 1)
            cg = g - t
            luma[y, x] = t + (cg >> 1) - int32(offset)
            orange[y, x] = co
            green[y, x] = cg


@compiled
def _split_rounded_colours(pixels: Array, offset: int, luma: Array, orange: Array, green: Array) -> None:
    shift = float32(offset)
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            b, g, r = float32(pixels[y, x, 0]), float32(pixels[y, x, 1]), float32(pixels[y, x, 2])
            mean = (b + r) * HALF
            luma[y, x] = (mean + g) * HALF - shift
            orange[y, x] = r - b
            green[y, x] = g - mean


def to_channels(pixels: Array, lossless: bool, offset: int) -> List[Array]:
    """Y, or Y, Co and Cg: (height, width) int32 or float32; the first one less the offset."""
    # views of messages are read-only: numba would compile all of it for them as well
    pixels = np.require(pixels, requirements=['C', 'A', 'W'])
    parts = [np.empty(pixels.shape[:2], np.int32 if lossless else np.float32)
             for _ in range(3 if pixels.ndim == 3 else 1)]
    if len(parts) == 1:
        _grey(pixels, offset, parts[0])
    else:
        split = _split_colours if lossless else _split_rounded_colours
        split(pixels, offset, parts[0], parts[1], parts[2])
    return parts


@compiled
def _from_grey(values: Array, offset: int, most: int, result: Array) -> None:
    for y in range(values.shape[0]):
        for x in range(values.shape[1]):
            result[y, x] = min(max(int32(values[y, x]) + int32(offset), int32(0)), int32(most))


@compiled
def _from_rounded_grey(values: Array, offset: int, most: int, result: Array) -> None:
    shift = float32(offset) + HALF
    highest = float32(most)
    for y in range(values.shape[0]):
        for x in range(values.shape[1]):
            result[y, x] = int32(min(max(values[y, x] + shift, float32(0)), highest))


@compiled
def _join_colours(luma: Array, orange: Array, green: Array, offset: int, result: Array) -> None:
    for y in range(luma.shape[0]):
        for x in range(luma.shape[1]):
            co, cg = orange[y, x], green[y, x]
            t = luma[y, x] + int32(offset) - (cg >> 1)
            b = t - (co >> 1)
            result[y, x, 0] = min(max(b, int32(0)), int32(255))
            result[y, x, 1] = min(max(cg + t, int32(0)), int32(255))
            result[y, x, 2] = min(max(b + co, int32(0)), int32(255))


@compiled
def _byte(value: float) -> Any:
    return int32(min(max(value, float32(0)), float32(255)))


@compiled
def _join_rounded_colours(luma: Array, orange: Array, green: Array, offset: int, result: Array) -> None:
    shift = float32(offset) + HALF
    for y in range(luma.shape[0]):
        for x in range(luma.shape[1]):
            co, cg = orange[y, x], green[y, x]
            t = luma[y, x] + shift - cg * HALF
            b = t - co * HALF
            result[y, x, 0] = _byte(b)
            result[y, x, 1] = _byte(cg + t)
            result[y, x, 2] = _byte(b + co)


def from_channels(parts: List[Array], lossless: bool, offset: int, itemsize: int) -> Array:
    """The pixels, clipped to what they can hold."""
    height, width = parts[0].shape
    if len(parts) == 1:
        grey = np.empty((height, width), np.uint8 if itemsize == 1 else np.uint16)
        (_from_grey if lossless else _from_rounded_grey)(parts[0], offset, 256 ** itemsize - 1, grey)
        return grey
    colours = np.empty((height, width, 3), np.uint8)
    (_join_colours if lossless else _join_rounded_colours)(parts[0], parts[1], parts[2], offset, colours)
    return colours
