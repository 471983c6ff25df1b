# SPDX-License-Identifier: BSD-3-Clause
"""Pixels to channels and back: YCoCg-R of colours (Malvar, Sullivan 2003), reversible of integers.

Channels are integers of 2^-fraction counts. With a fraction of 0 halves are rounded down; from 2 on they are exact.
"""
from typing import List

import numpy as np

from ...arrays import Array
from .loops import compiled, int32, int64


@compiled
def _grey(pixels: Array, offset: int, fraction: int, result: Array) -> None:
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            result[y, x] = (int32(pixels[y, x]) - int32(offset)) << fraction


@compiled
def _split_colours(pixels: Array, offset: int, fraction: int, luma: Array, orange: Array, green: Array) -> None:
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            b, g, r = int32(pixels[y, x, 0]), int32(pixels[y, x, 1]), int32(pixels[y, x, 2])
            co = (r - b) << fraction
            t = (b << fraction) + (co >> 1)
            cg = (g << fraction) - t
            luma[y, x] = t + (cg >> 1) - (offset << fraction)
            orange[y, x] = co
            green[y, x] = cg


def to_channels(pixels: Array, offset: int, fraction: int) -> List[Array]:
    """Y, or Y, Co and Cg: (height, width) int32 [2^-fraction]; the first one less the offset."""
    # views of messages are read-only: numba would compile all of it for them as well
    pixels = np.require(pixels, requirements=['C', 'A', 'W'])
    parts = [np.empty(pixels.shape[:2], np.int32) for _ in range(3 if pixels.ndim == 3 else 1)]
    if len(parts) == 1:
        _grey(pixels, offset, fraction, parts[0])
    else:
        _split_colours(pixels, offset, fraction, parts[0], parts[1], parts[2])
    return parts


@compiled
def _from_grey(values: Array, offset: int, fraction: int, most: int, result: Array) -> None:
    shift = (offset << fraction) + ((1 << fraction) >> 1)
    for y in range(values.shape[0]):
        for x in range(values.shape[1]):
            result[y, x] = min(max((values[y, x] + shift) >> fraction, int64(0)), int64(most))


@compiled
def _join_colours(luma: Array, orange: Array, green: Array, offset: int, fraction: int, result: Array) -> None:
    shift = (offset << fraction) + ((1 << fraction) >> 1)
    for y in range(luma.shape[0]):
        for x in range(luma.shape[1]):
            co, cg = int64(orange[y, x]), int64(green[y, x])
            t = luma[y, x] + shift - (cg >> 1)
            b = t - (co >> 1)
            result[y, x, 0] = min(max(b >> fraction, int64(0)), int64(255))
            result[y, x, 1] = min(max((cg + t) >> fraction, int64(0)), int64(255))
            result[y, x, 2] = min(max((b + co) >> fraction, int64(0)), int64(255))


def from_channels(parts: List[Array], offset: int, fraction: int, itemsize: int) -> Array:
    """The pixels, clipped to what they can hold."""
    height, width = parts[0].shape
    if len(parts) == 1:
        grey = np.empty((height, width), np.uint8 if itemsize == 1 else np.uint16)
        _from_grey(parts[0], offset, fraction, 256 ** itemsize - 1, grey)
        return grey
    colours = np.empty((height, width, 3), np.uint8)
    _join_colours(parts[0], parts[1], parts[2], offset, fraction, colours)
    return colours
