# SPDX-License-Identifier: BSD-3-Clause
"""Pixels to channels and back: YCoCg-R of colours (Malvar, Sullivan 2003), reversible of integers.

Channels are integers of 2^-fraction counts. With a fraction of 0 halves are rounded down; from 2 on they are exact.
"""
from typing import List, Tuple

import numpy as np

from ...arrays import Array
from .loops import compiled, int32, int64


@compiled
def _split_colours(pixels: Array, offset: int, fraction: int, luma: Array, orange: Array, green: Array) -> None:
    """Convert all pixels from B, G, R, (3 n,) uint8, to Y, Co and Cg, (n,) int32 each."""
    subtracted = int32(offset << fraction)
    for i in range(len(luma)):
        b, g, r = int32(pixels[3 * i]), int32(pixels[3 * i + 1]), int32(pixels[3 * i + 2])
        co = int32(int32(r - b) << int32(fraction))
        t = int32(int32(b << int32(fraction)) + int32(co >> 1))
        cg = int32(int32(g << int32(fraction)) - t)
        luma[i] = int32(int32(t + int32(cg >> 1)) - subtracted)
        orange[i] = co
        green[i] = cg


def to_channels(pixels: Array, offset: int, fraction: int) -> List[Tuple[Array, int, int]]:
    """The channels, Y or Y, Co and Cg. Each one is (its (height, width) pixels or int32, what is still to be subtracted
    from it, the log2 of the factor that then makes it 2^-fraction counts). The first channel is less the offset."""
    # views of messages are read-only: numba would compile all of it for them as well
    pixels = np.require(pixels, requirements=['C', 'A', 'W'])
    if pixels.ndim == 2:
        return [(pixels, offset, fraction)]
    parts = [np.empty(pixels.shape[:2], np.int32) for _ in range(3)]
    luma, orange, green = (part.reshape(-1) for part in parts)
    _split_colours(pixels.reshape(-1), offset, fraction, luma, orange, green)
    return [(part, 0, 0) for part in parts]


def rounding(offset: int, fraction: int, itemsize: int) -> Tuple[int, int, int]:
    """How values of 2^-fraction counts less an offset become pixels, see wavelet.rounded: shift, fraction, most."""
    return (offset << fraction) + ((1 << fraction) >> 1), fraction, 256 ** itemsize - 1


@compiled
def _join_colours(luma: Array, orange: Array, green: Array, shift: int, fraction: int, result: Array) -> None:
    """Convert all pixels from Y, Co and Cg, (n,) int32 each, to B, G, R, (3 n,) uint8."""
    for i in range(len(luma)):
        co, cg = int64(orange[i]), int64(green[i])
        t = luma[i] + shift - (cg >> 1)
        b = t - (co >> 1)
        result[3 * i] = min(max(b >> fraction, int64(0)), int64(255))
        result[3 * i + 1] = min(max((cg + t) >> fraction, int64(0)), int64(255))
        result[3 * i + 2] = min(max((b + co) >> fraction, int64(0)), int64(255))


def from_channels(parts: List[Array], shift: int, fraction: int) -> Array:
    """The pixels of three channels, clipped to what they can hold: (height, width, 3) uint8.

    :param shift: see rounding
    """
    colours = np.empty((*parts[0].shape, 3), np.uint8)
    luma, orange, green = (part.reshape(-1) for part in parts)
    _join_colours(luma, orange, green, shift, fraction, colours.reshape(-1))
    return colours
