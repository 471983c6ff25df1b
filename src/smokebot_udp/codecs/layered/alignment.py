# SPDX-License-Identifier: BSD-3-Clause
"""The mesh that displaces a reference onto an image with the least squared error.

Both are halved repeatedly. A shift is sought among all small ones of the coarsest pair (Gauss-Newton would find the
nearest minimum only). Each finer pair and mesh refines it by a Gauss-Newton step on all nodes at once (Lucas and Kanade
1981, Baker and Matthews 2004), whose normal equations are banded. Where a mesh bends otherwise than the coarser one it
pays a price, so that nodes without texture follow the others.

Its numbers are floating-point ones and differ from one machine to another: both sides use what is sent.
"""
import math
from typing import List, NamedTuple, Tuple

import numpy as np
from scipy.linalg import solveh_banded

from ...arrays import Array, Float32Array, FloatArray
from .loops import compiled, float32, summed, uint64

COARSEST = 20
"""Minimum length of the shorter side of the coarsest images: it is not halved below this [pixel]."""
LEAST_SIDE = 16
"""Minimum length of the sides of images that are aligned [pixel]."""
REACH = 4
"""Shifts of up to the coarsest image's sides divided by this are tried, limited by MOST_SHIFT."""
MOST_SHIFT = 24
"""Maximum shift that is tried: long narrow images, such as those of lidars, are hardly halved [pixel]."""
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
ONE, HALF, QUARTER = uint64(1), float32(0.5), float32(0.25)
# what is observed in a row of a cell: squared errors by their weights, roots of roots of squared differences, number of
# runs; sums of the products of slopes and differences, plain and times u, the place in the cell; sums of the products
# yy, yx, xx of slopes, plain, times u and times its square
ERROR, ROOTS, COUNT, PULLS, PRODUCTS = 0, 1, 2, 3, 7


@compiled
def _luma(pixels: Array, result: Array) -> None:
    """(3 n,) to (n,) float32."""
    for i in range(uint64(len(result))):
        at = i + i + i
        result[i] = (float32(pixels[at]) + float32(pixels[at + ONE + ONE])) * QUARTER + float32(pixels[at + ONE]) * HALF


@compiled
def _halve_row(image: Array, above: int, below: int, result: Array, at: int, count: int) -> None:
    """Means of 2 x 2 pixels; the numbers are uint64."""
    for i in range(count):
        left, right = i + i, i + i + ONE
        result[at + i] = (float32(image[above + left]) + float32(image[above + right]) + float32(
            image[below + left]) + float32(image[below + right])) * QUARTER


@compiled
def _halve(image: Array, width: int, result: Array) -> None:
    """Half of a flat image, (height, width) float32; an odd last row or column is left out."""
    flat, columns = result.reshape(-1), uint64(result.shape[1])
    for y in range(uint64(result.shape[0])):
        above = (y + y) * uint64(width)
        _halve_row(image, above, above + uint64(width), flat, y * columns, columns)


def _half(image: Array) -> Float32Array:
    result = np.empty((image.shape[0] // 2, image.shape[1] // 2), np.float32)
    _halve(image.reshape(-1), image.shape[1], result)
    return result


def _pyramid(pixels: Array, large: bool) -> List[Float32Array]:
    """The image in grey, less its mean; half of it, and so on.

    :param large: half of it comes first
    """
    grey = np.require(pixels, requirements=['C', 'A', 'W'])
    if pixels.ndim == 3:
        colours, grey = grey, np.empty(pixels.shape[:2], np.float32)
        _luma(colours.reshape(-1), grey.reshape(-1))
    images = [_half(grey) if large else grey.astype(np.float32)]
    images[0] -= images[0].mean()
    while min(images[-1].shape) >= 2 * COARSEST:
        images.append(_half(images[-1]))
    return images


@summed
def _apart(image: Array, at: int, reference: Array, there: int, count: int) -> float:
    """The sum of the roots of how much pixels of two flat images differ; the numbers are uint64."""
    total = float32(0)
    for i in range(count):
        total += math.sqrt(abs(image[at + i] - reference[there + i]))
    return float(total)


@compiled
def _error(image: Array, reference: Array, height: int, width: int, dy: int, dx: int, most: float) -> float:
    """The error of a shift for each pixel of the flat images; or an error that is not below `most`."""
    columns = width - abs(dx)
    total, limit = 0.0, most * (height - abs(dy)) * columns
    for y in range(max(-dy, 0), min(height - dy, height)):
        total += _apart(image, uint64(y * width + max(-dx, 0)), reference, uint64((y + dy) * width + max(dx, 0)),
                        uint64(columns))
        if total >= limit:
            break
    return total / ((height - abs(dy)) * columns)


@compiled
def _best_shift(image: Array, reference: Array, height: int, width: int, down: int, right: int) -> Tuple[int, int]:
    """The shift, -down..down and -right..right, with the least error, of flat images; small ones are tried first."""
    best, least = (0, 0), _error(image, reference, height, width, 0, 0, np.inf)
    for ring in range(1, max(down, right) + 1):
        for dy in range(-min(ring, down), min(ring, down) + 1):
            for dx in range(-min(ring, right), min(ring, right) + 1):
                if max(abs(dy), abs(dx)) == ring:
                    error = _error(image, reference, height, width, dy, dx, least)
                    if error < least:
                        best, least = (dy, dx), error
    return best


@compiled
def _sums(image: Array, at: int, width: int, reference: Array, there: int, below: float, behind: float
          ) -> Tuple[float, float, float, float, float, float]:
    """Over RUN pixels of flat images: products of the image's slopes, down and right, with each other and with the
    difference to the reference `below` and `behind` its pixel `there`; and the squared difference."""
    yy, yx, xx, ye, xe, ee = (float32(0), float32(0), float32(0), float32(0), float32(0), float32(0))
    for k in range(uint64(RUN)):
        here, there_too = at + k, there + k
        down = (image[here + width] - image[here - width]) * HALF
        right = (image[here + ONE] - image[here - ONE]) * HALF
        above = reference[there_too] + (reference[there_too + ONE] - reference[there_too]) * behind
        under = reference[there_too + width] + (
            reference[there_too + width + ONE] - reference[there_too + width]) * behind
        difference = image[here] - (above + (under - above) * below)
        yy += down * down
        yx += down * right
        xx += right * right
        ye += down * difference
        xe += right * difference
        ee += difference * difference
    return yy, yx, xx, ye, xe, ee


class Runs(NamedTuple):
    """Runs of RUN pixels in a row of a cell of the mesh."""
    first: int
    """Column where the first one begins."""
    last: int
    """Column behind the last one."""
    place: float
    """Where the first one is between the cell's sides, 0..1."""
    pace: float
    """From the place of one to that of the next column."""


@compiled
def _observe_cell(image: Array, reference: Array, size: Tuple[int, int], y: int, runs: Runs, sides: Tuple[Array, Array],
                  usual: float, sums: Array) -> None:
    """Add up what is observed in a row of a cell of the mesh.

    :param size: height and width
    :param sides: each (2,): displacements of the cell's left and right side, down and right [pixel]
    :param sums: (16,) float64, see ERROR and the others; is added to
    """
    (height, width), (first, last, place, pace), (left, right) = size, runs, sides
    for x in range(first, last, RUN):
        u = place + (x - first) * pace
        at_y, at_x = y + left[0] + u * (right[0] - left[0]), x + left[1] + u * (right[1] - left[1])
        if not (at_y >= 0 and at_x >= 0 and at_y < height - 1 and at_x < width - RUN):
            continue
        i, j = int(at_y), int(at_x)
        yy, yx, xx, ye, xe, ee = _sums(image, uint64(y * width + x), uint64(width), reference, uint64(i * width + j),
                                       float32(at_y - i), float32(at_x - j))
        trust = usual / (usual + ee * (1 / RUN)) if usual < np.inf else 1.0
        sums[ERROR] += trust * ee
        sums[ROOTS] += math.sqrt(math.sqrt(ee * (1 / RUN)))
        sums[COUNT] += 1
        ye, xe = trust * ye, trust * xe
        sums[PULLS] += ye
        sums[PULLS + 1] += xe
        sums[PULLS + 2] += u * ye
        sums[PULLS + 3] += u * xe
        for k in range(3):
            sums[PRODUCTS + k] += trust * yy
            sums[PRODUCTS + 3 + k] += trust * yx
            sums[PRODUCTS + 6 + k] += trust * xx
            trust *= u


@compiled
def _distribute(sums: Array, v: float, products: Array, pulls: Array, row: int, cell: int) -> None:
    """Add what was observed in a row of a cell, at v between its upper and its lower side, to the normal equations."""
    for k, down in ((0, (1 - v) * (1 - v)), (1, (1 - v) * v), (2, v * v)):
        for slopes in range(3):
            plain, once, twice = sums[PRODUCTS + 3 * slopes], sums[PRODUCTS + 3 * slopes + 1], sums[
                PRODUCTS + 3 * slopes + 2]
            products[row, cell, k, 0, slopes] += down * (plain - 2 * once + twice)
            products[row, cell, k, 1, slopes] += down * (once - twice)
            products[row, cell, k, 2, slopes] += down * twice
    for k in range(2):
        plain, once = sums[PULLS + k], sums[PULLS + 2 + k]
        pulls[row, cell, k] += (1 - v) * (plain - once)
        pulls[row, cell + 1, k] += (1 - v) * once
        pulls[row + 1, cell, k] += v * (plain - once)
        pulls[row + 1, cell + 1, k] += v * once


@compiled
def _observe(image: Array, reference: Array, size: Tuple[int, int], nodes: Array, step: int, usual: float,
             products: Array, pulls: Array) -> Tuple[float, float]:
    """The normal equations of each `step`-th row of flat images.

    :param size: height and width
    :param nodes: (n, n, 2) float64: displacements down and right [pixel]
    :param products: (n - 1, n - 1, 3, 3, 3) float64, is added to: of each cell; by the nodes that share it: above with
        above, above with below, below with below, then likewise left and right; of slopes: yy, yx, xx
    :param pulls: (n, n, 2) float64, is added to: of slopes and differences
    :param usual: squared difference; pixels of much larger ones have less weight
    :returns: the squared error of all pixels, by their weights, and a usual one
    """
    (height, width), cells = size, nodes.shape[0] - 1
    error, roots, count, sums = 0.0, 0.0, 0.0, np.empty(16)
    for y in range(1 + step // 2, height - 1, step):
        v = (y + 0.5) * cells / height
        row = min(int(v), cells - 1)
        v -= row
        sides = (1 - v) * nodes[row] + v * nodes[row + 1]
        x = 1
        for cell in range(cells):
            # runs whose middle is in the cell
            behind = width - RUN if cell == cells - 1 else min(int((cell + 1) * width / cells - 0.5 * RUN), width - RUN)
            last = x + max(behind - x + RUN - 1, 0) // RUN * RUN
            sums[:] = 0
            runs = Runs(x, last, (x + 0.5 * RUN) * cells / width - cell, cells / width)
            _observe_cell(image, reference, size, y, runs, (sides[cell], sides[cell + 1]), usual, sums)
            _distribute(sums, v, products, pulls, row, cell)
            error, roots, count = error + sums[ERROR], roots + sums[ROOTS], count + sums[COUNT]
            x = last
    return error, (roots / max(count, 1.0)) ** 4


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
    one, other, shape = image.reshape(-1), reference.reshape(-1), (image.shape[0], image.shape[1])
    _, usual = _observe(one, other, shape, nodes, COARSE * rows, np.inf, *_nothing(size))
    products, pulls = _nothing(size)
    error, _ = _observe(one, other, shape, nodes, rows, OUTLIER * usual + 1e-6, products, pulls)
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
    nodes = np.zeros((2, 2, 2)) + _best_shift(images[-1].reshape(-1), references[-1].reshape(-1), height, width, down,
                                              right)
    for number in reversed(range(1, len(images))):
        nodes = 2 * _refined(images[number], references[number], nodes)
        if len(nodes) < 1 + (1 << level) // 2:
            nodes = _prolonged(nodes)
    while len(nodes) < 1 + (1 << level):
        nodes = _prolonged(nodes)
    nodes = _refined(images[0], references[0], nodes)
    return 2 * nodes if large else nodes
