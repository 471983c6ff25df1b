# SPDX-License-Identifier: BSD-3-Clause
"""Convex hulls, and the price for bytes that fills the datagrams (H. Everett, Operations Research 11(3), 1963)."""
import math

import numpy as np

from ...arrays import FloatArray, IntArray
from .loops import compiled

BISECTIONS = 20


@compiled
def hull_points(x: FloatArray, y: FloatArray) -> IntArray:
    """Which points, with ascending x, are the corners of their upper convex hull up to the highest one."""
    kept = np.empty(len(x), np.int64)
    number = 0
    for i in range(np.argmax(y) + 1):
        while number > 1 and (y[i] - y[kept[number - 1]]) * (x[kept[number - 1]] - x[kept[number - 2]]) >= (
                y[kept[number - 1]] - y[kept[number - 2]]) * (x[i] - x[kept[number - 1]]):
            number -= 1
        if number == 0 or x[i] > x[kept[number - 1]]:
            kept[number] = i
            number += 1
    return kept[:number]


@compiled
def bytes_at_price(price: float, slopes: FloatArray, sizes: FloatArray, gains: FloatArray, shares: FloatArray
                   ) -> FloatArray:
    """(g,) what each threshold's pieces take of a datagram where each part of a stream takes the best one [byte].

    :param price: of a byte of a datagram, in terms of the worth
    :param slopes: (s,) descending: what a byte of each part is worth
    :param sizes: (s,) of the parts [byte]
    :param gains: (g,) descending: how much likelier each threshold is restored than the one before, for a byte more
    :param shares: (g,) bytes of a datagram for one of the stream
    """
    taken = np.zeros(len(gains))
    affordable = len(gains)
    for i in range(len(slopes)):
        while affordable > 0 and gains[affordable - 1] * slopes[i] <= price:
            affordable -= 1
        if affordable > 0:
            taken[affordable - 1] += sizes[i] * shares[affordable - 1]
    return taken


@compiled
def filling_bytes(available: float, slopes: FloatArray, sizes: FloatArray, gains: FloatArray, shares: FloatArray
                  ) -> FloatArray:
    """(g,) as `bytes_at_price`, at the price that fills the `available` bytes of a datagram, or at the lowest one."""
    # dearer than anything, and cheaper than everything
    high, low = math.log(slopes[0] * gains[0] * 1.01), math.log(slopes[-1] * gains[-1] * 0.99)
    few = bytes_at_price(math.exp(high), slopes, sizes, gains, shares)
    many = bytes_at_price(math.exp(low), slopes, sizes, gains, shares)
    if many.sum() <= available:
        return many
    for _ in range(BISECTIONS):
        price = (low + high) / 2
        middle = bytes_at_price(math.exp(price), slopes, sizes, gains, shares)
        if middle.sum() > available:
            low, many = price, middle
        else:
            high, few = price, middle
    # a part of the stream changes its threshold at the exact price: some of it does
    part = (available - few.sum()) / (many.sum() - few.sum())
    filling: FloatArray = (1 - part) * few + part * many
    return filling
