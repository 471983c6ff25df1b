# SPDX-License-Identifier: BSD-3-Clause
"""The mesh that displaces a reference onto an image with the least squared error.

Both are halved repeatedly. A shift is sought among all small ones of the coarsest pair (Gauss-Newton would find the
nearest minimum only). Each finer pair and mesh refines it by a Gauss-Newton step on all nodes at once (Lucas and Kanade
1981, Baker and Matthews 2004), whose normal equations are banded. Where a mesh bends otherwise than the coarser one it
pays a price, so that nodes without texture follow the others.

Its numbers are floating-point ones and differ from one machine to another: both sides use what is sent.
"""
import math
from typing import List, Tuple

import numpy as np
from scipy.linalg import solveh_banded

from ...arrays import Array, Float32Array, FloatArray
from .loops import compiled, float32

COARSEST = 20
"""The shorter side of the coarsest images is not halved below this [pixel]."""
LEAST_SIDE = 16
"""Of images that are aligned [pixel]."""
REACH = 4
"""Shifts of up to this part of the coarsest image's sides are tried: a quarter,"""
MOST_SHIFT = 24
"""but not more: long narrow images, such as those of lidars, are hardly halved [pixel]."""
LARGE = 1 << 17
"""Images of more pixels are halved first: that takes half the time, and less than a thousandth more is left to code."""
SAMPLES = 10000
"""About this number of pixels of a pair is used, of whole rows."""
STIFFNESS = 0.5
"""Price of bending, in noise: a node's neighbours a pixel aside cost this part of the squared errors around it."""
OUTLIER = 9.0
"""Pixels whose squared difference is this many times a usual one have half the weight: they move by themselves."""
COARSE = 4
"""The usual difference at first is taken from each COARSE-th of the rows."""
RUN = 4
"""Pixels that are displaced alike."""


@compiled
def _luma(pixels: Array, result: Array) -> None:
    """(height, width, 3) to (height, width) float32."""
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            result[y, x] = (float32(pixels[y, x, 0]) + float32(pixels[y, x, 2])) * float32(0.25) + float32(
                pixels[y, x, 1]) * float32(0.5)


@compiled
def _halve(image: Array, result: Array) -> None:
    """Means of 2 x 2 pixels, float32; an odd last row or column is left out."""
    for y in range(result.shape[0]):
        above, below = image[2 * y], image[2 * y + 1]
        for x in range(result.shape[1]):
            result[y, x] = (float32(above[2 * x]) + float32(above[2 * x + 1]) + float32(below[2 * x]) + float32(
                below[2 * x + 1])) * float32(0.25)


def _half(image: Array) -> Float32Array:
    result = np.empty((image.shape[0] // 2, image.shape[1] // 2), np.float32)
    _halve(image, result)
    return result


def _pyramid(pixels: Array, large: bool) -> List[Float32Array]:
    """The image in grey, less its mean; half of it, and so on.

    :param large: half of it comes first
    """
    grey = np.require(pixels, requirements=['C', 'A', 'W'])
    if pixels.ndim == 3:
        grey = np.empty(pixels.shape[:2], np.float32)
        _luma(np.require(pixels, requirements=['C', 'A', 'W']), grey)
    images = [_half(grey) if large else grey.astype(np.float32)]
    images[0] -= images[0].mean()
    while min(images[-1].shape) >= 2 * COARSEST:
        images.append(_half(images[-1]))
    return images


@compiled
def _best_shift(image: Array, reference: Array, down: int, right: int) -> Tuple[int, int]:
    """The shift, -down..down and -right..right, with the least error a pixel (of which the roots are added)."""
    height, width = image.shape
    best, least = (0, 0), np.inf
    for dy in range(-down, down + 1):
        for dx in range(-right, right + 1):
            total = float32(0)
            for y in range(max(-dy, 0), min(height - dy, height)):
                for x in range(max(-dx, 0), min(width - dx, width)):
                    total += math.sqrt(abs(image[y, x] - reference[y + dy, x + dx]))
            mean = total / ((height - abs(dy)) * (width - abs(dx)))
            if mean < least:
                best, least = (dy, dx), mean
    return best


@compiled
def _sums(image: Array, reference: Array, y: int, x: int, row: int, column: int, below: float, behind: float
          ) -> Tuple[float, float, float, float, float, float]:
    """Over RUN pixels from (y, x) on: products of the image's slopes, down and right, with each other and with the
    difference to the reference at (row + below, column + behind); and the squared difference."""
    yy, yx, xx, ye, xe, ee = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(RUN):
        down = (image[y + 1, x + k] - image[y - 1, x + k]) * float32(0.5)
        right = (image[y, x + k + 1] - image[y, x + k - 1]) * float32(0.5)
        i = column + k
        above = reference[row, i] + (reference[row, i + 1] - reference[row, i]) * behind
        under = reference[row + 1, i] + (reference[row + 1, i + 1] - reference[row + 1, i]) * behind
        difference = image[y, x + k] - (above + (under - above) * below)
        yy += down * down
        yx += down * right
        xx += right * right
        ye += down * difference
        xe += right * difference
        ee += difference * difference
    return yy, yx, xx, ye, xe, ee


@compiled
def _observe(image: Array, reference: Array, nodes: Array, step: int, usual: float, products: Array, pulls: Array
             ) -> Tuple[float, float]:
    """The normal equations of each `step`-th row.

    :param nodes: (n, n, 2) float64: displacements down and right [pixel]
    :param products: (n - 1, n - 1, 3, 3, 3) float64, is added to: of each cell; by the nodes that share it: above with
        above, above with below, below with below, then likewise left and right; of slopes: yy, yx, xx
    :param pulls: (n, n, 2) float64, is added to: of slopes and differences
    :param usual: squared difference; pixels of much larger ones have less weight
    :returns: the squared error of all pixels, by their weights, and a usual one
    """
    height, width = image.shape
    cells = nodes.shape[0] - 1
    error, roots, count = 0.0, 0.0, 0
    for y in range(1 + step // 2, height - 1, step):
        v = (y + 0.5) * cells / height
        row = min(int(v), cells - 1)
        v -= row
        upper, lower = nodes[row], nodes[row + 1]
        for x in range(1, width - RUN, RUN):
            u = (x + 0.5 * RUN) * cells / width
            cell = min(int(u), cells - 1)
            u -= cell
            a, b, c, d = (1 - v) * (1 - u), (1 - v) * u, v * (1 - u), v * u
            at_y = y + a * upper[cell, 0] + b * upper[cell + 1, 0] + c * lower[cell, 0] + d * lower[cell + 1, 0]
            at_x = x + a * upper[cell, 1] + b * upper[cell + 1, 1] + c * lower[cell, 1] + d * lower[cell + 1, 1]
            if not (at_y >= 0 and at_x >= 0 and at_y < height - 1 and at_x < width - RUN):
                continue
            i, j = int(at_y), int(at_x)
            yy, yx, xx, ye, xe, ee = _sums(image, reference, y, x, i, j, float32(at_y - i), float32(at_x - j))
            trust = 1 / (1 + ee / (RUN * usual))
            error += trust * ee
            roots += math.sqrt(math.sqrt(ee / RUN))
            count += 1
            ye, xe = trust * ye, trust * xe
            for k, down in ((0, (1 - v) * (1 - v)), (1, (1 - v) * v), (2, v * v)):
                for m, across in ((0, (1 - u) * (1 - u)), (1, (1 - u) * u), (2, u * u)):
                    weight = down * across * trust
                    products[row, cell, k, m, 0] += weight * yy
                    products[row, cell, k, m, 1] += weight * yx
                    products[row, cell, k, m, 2] += weight * xx
            pulls[row, cell, 0] += a * ye
            pulls[row, cell, 1] += a * xe
            pulls[row, cell + 1, 0] += b * ye
            pulls[row, cell + 1, 1] += b * xe
            pulls[row + 1, cell, 0] += c * ye
            pulls[row + 1, cell, 1] += c * xe
            pulls[row + 1, cell + 1, 0] += d * ye
            pulls[row + 1, cell + 1, 1] += d * xe
    return error, (roots / max(count, 1)) ** 4


@compiled
def _assemble(products: Array, price: float, matrix: Array) -> None:
    """Add the products of cells, and the price of bending, to the upper band of the matrix (scipy's form)."""
    cells = products.shape[0]
    size = cells + 1
    for row in range(cells):
        for column in range(cells):
            for one in range(4):
                for other in range(4):
                    i = 2 * ((row + (one >> 1)) * size + column + (one & 1))
                    j = 2 * ((row + (other >> 1)) * size + column + (other & 1))
                    _add(matrix, i, j, products[row, column, (one >> 1) + (other >> 1), (one & 1) + (other & 1)])
    for i in range(2 * size * size):
        if i % (2 * size) < 2 * cells:
            _bind(matrix, i, i + 2, price)
        if i + 2 * size < 2 * size * size:
            _bind(matrix, i, i + 2 * size, price)


@compiled
def _add(matrix: Array, i: int, j: int, products: Array) -> None:
    """Add the products of slopes where the unknowns of two nodes, which begin at i and j, meet in the upper half."""
    top = matrix.shape[0] - 1
    for p in range(2):
        for q in range(2):
            if i + p <= j + q:
                matrix[top + i + p - j - q, j + q] += products[p + q]


@compiled
def _bind(matrix: Array, i: int, j: int, price: float) -> None:
    """Add a price of the squared difference of two unknowns."""
    top = matrix.shape[0] - 1
    matrix[top, i] += price
    matrix[top, j] += price
    matrix[top + i - j, j] -= price


def _refined(image: Float32Array, reference: Float32Array, nodes: FloatArray) -> FloatArray:
    """The mesh after a Gauss-Newton step."""
    size, rows = len(nodes), max(image.size // SAMPLES, 1)
    _, usual = _observe(image, reference, nodes, COARSE * rows, np.inf, *_nothing(size))
    products, pulls = _nothing(size)
    error, _ = _observe(image, reference, nodes, rows, OUTLIER * usual + 1e-6, products, pulls)
    price = STIFFNESS * error / size ** 2
    matrix = np.zeros((2 * (size + 2), nodes.size))
    _assemble(products, price, matrix)
    matrix[-1] += 1e-3 * price + 1e-6 * matrix[-1].mean() + 1e-6
    moved: FloatArray = nodes + solveh_banded(matrix, pulls.reshape(-1)).reshape(nodes.shape)
    return moved


def _nothing(size: int) -> Tuple[FloatArray, FloatArray]:
    """Empty normal equations of a mesh."""
    return np.zeros((size - 1, size - 1, 3, 3, 3)), np.zeros((size, size, 2))


def _prolonged(nodes: FloatArray) -> FloatArray:
    """The mesh of the next level that displaces alike: (n, n, 2) to (2 n - 1, 2 n - 1, 2)."""
    finer = np.empty((2 * len(nodes) - 1, 2 * len(nodes) - 1, 2))
    finer[::2, ::2] = nodes
    finer[1::2, ::2] = (nodes[:-1] + nodes[1:]) / 2
    finer[:, 1::2] = (finer[:, :-1:2] + finer[:, 2::2]) / 2
    return finer


def aligned(reference: Array, image: Array, level: int) -> FloatArray:
    """The mesh: (n, n, 2) float64, n = 2^level + 1: displacements down and right [pixel].

    :param reference: (height, width) uint8 or uint16, or (height, width, 3) uint8; no side is below LEAST_SIDE
    :param image: of the same shape and type
    """
    large = image.shape[0] * image.shape[1] > LARGE
    images, references = _pyramid(image, large), _pyramid(reference, large)
    height, width = images[-1].shape
    down, right = min(height // REACH, MOST_SHIFT), min(width // REACH, MOST_SHIFT)
    nodes = np.zeros((2, 2, 2)) + _best_shift(images[-1], references[-1], down, right)
    for number in reversed(range(1, len(images))):
        nodes = 2 * _refined(images[number], references[number], nodes)
        if len(nodes) < 1 + (1 << level) // 2:
            nodes = _prolonged(nodes)
    while len(nodes) < 1 + (1 << level):
        nodes = _prolonged(nodes)
    nodes = _refined(images[0], references[0], nodes)
    return 2 * nodes if large else nodes
