# SPDX-License-Identifier: BSD-3-Clause
"""The direction in which an image changes least, at each of its pixels: along its edges.

It is estimated from the structure tensor, the local mean of the products of the gradient (W. Forstner and E. Gulch,
1987). It is a vector at twice the edge's angle, whose length is the edge's clarity: such vectors can be averaged.
"""
import cv2
import numpy as np

from ...arrays import Array, Float32Array

STRETCH = 1.5
"""Factor by which pixels are alike farther along an edge, and less far across it."""

DIRECTIONS = 4
"""Level, falling to the right, upright, rising: the signs of the vector's two numbers distinguish them."""


def along(offsets: Array) -> Float32Array:
    """Effective offsets if an edge runs along each of the directions.

    :param offsets: (..., 2) numbers, down and right [pixel]
    :return: (DIRECTIONS, ..., 2) float32: along the edge and across it, shrunk and stretched
    """
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    onto = np.array([(np.sin(angle) / STRETCH, np.cos(angle) / STRETCH),
                     (np.cos(angle) * STRETCH, -np.sin(angle) * STRETCH)], np.float32)      # (which, from, direction)
    effective: Float32Array = np.einsum('wfd,...f->d...w', onto, offsets.astype(np.float32))
    return effective


def edges(image: Float32Array, spacing: float) -> Float32Array:
    """The direction of edges, and their clarity.

    :param image: (height, width) float32
    :param spacing: mean distance of the received pixels [pixel]
    :return: (height, width, 2) float32: the first direction minus the third, the second minus the fourth; their
        absolute values sum to 1 at most
    """
    height, width = image.shape
    scale = max(1, int(min(spacing, height, width)))    # nothing finer is known
    sigma = spacing / scale
    coarse = cv2.resize(image, (width // scale, height // scale), interpolation=cv2.INTER_AREA)
    coarse = cv2.GaussianBlur(coarse, (0, 0), 0.5 * sigma)
    right, down = cv2.Sobel(coarse, cv2.CV_32F, 1, 0), cv2.Sobel(coarse, cv2.CV_32F, 0, 1)
    level, slanting, both = (cv2.GaussianBlur(product, (0, 0), sigma) for product in (
        down * down - right * right, -2 * right * down, right * right + down * down))
    length = np.sqrt(level * level + slanting * slanting) / (both + np.float32(1e-6))
    ratio = length / (np.abs(level) + np.abs(slanting) + np.float32(1e-12))
    found: Float32Array = cv2.resize(cv2.merge([level * ratio, slanting * ratio]), (width, height),
                                     interpolation=cv2.INTER_LINEAR)
    return found


def blended(isotropic: Float32Array, steered: Float32Array, found: Float32Array) -> Float32Array:
    """Estimates that follow the edges, in proportion to their clarity.

    :param isotropic: (...) float32, the estimates without an edge
    :param steered: (DIRECTIONS, ...) float32, those along each direction
    :param found: (..., 2) float32, from edges()
    :return: (...) float32
    """
    result = isotropic.copy()
    for one, other, vector in ((0, 2, found[..., 0]), (1, 3, found[..., 1])):
        result += np.where(vector > 0, steered[one] - isotropic, isotropic - steered[other]) * vector
    return result
