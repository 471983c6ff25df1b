# SPDX-License-Identifier: BSD-3-Clause
"""Along which direction a picture changes least, at each of its pixels: along its edges.

From the structure tensor, the mean of the gradient's products around a pixel (W. Forstner and E. Gulch, 1987). It is
told as a vector at twice the edge's angle, whose length is how clear the edge is: such vectors may be averaged.
"""
import cv2
import numpy as np

STRETCH = 1.5
"""Along an edge pixels look alike farther by this factor, across it less far."""

DIRECTIONS = 4
"""Level, falling to the right, upright, rising: what the vector's two numbers tell apart when positive or negative."""


def along(offsets):
    """Offsets as they count where an edge runs along each of the directions.

    :param offsets: (..., 2) numbers, down and right [pixel]
    :return: (DIRECTIONS, ..., 2) float32: along the edge and across it, shrunk and stretched
    """
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    onto = np.array([(np.sin(angle) / STRETCH, np.cos(angle) / STRETCH),
                     (np.cos(angle) * STRETCH, -np.sin(angle) * STRETCH)], np.float32)      # (which, from, direction)
    return np.einsum('wfd,...f->d...w', onto, offsets.astype(np.float32))


def edges(picture, spacing):
    """Where edges run, and how clear they are.

    :param picture: (height, width) float32
    :param spacing: of the pixels that were received, in the mean [pixel]
    :return: (height, width, 2) float32: of the first direction minus the third, of the second minus the fourth; their
             sizes sum to 1 at most
    """
    height, width = picture.shape
    scale = max(1, int(min(spacing, height, width)))    # finer than that nothing is known
    sigma = spacing / scale
    coarse = cv2.resize(picture, (width // scale, height // scale), interpolation=cv2.INTER_AREA)
    coarse = cv2.GaussianBlur(coarse, (0, 0), 0.5 * sigma)
    right, down = cv2.Sobel(coarse, cv2.CV_32F, 1, 0), cv2.Sobel(coarse, cv2.CV_32F, 0, 1)
    level, slanting, both = (cv2.GaussianBlur(product, (0, 0), sigma) for product in (
        down * down - right * right, -2 * right * down, right * right + down * down))
    length = np.sqrt(level * level + slanting * slanting) / (both + np.float32(1e-6))
    share = length / (np.abs(level) + np.abs(slanting) + np.float32(1e-12))
    return cv2.resize(cv2.merge([level * share, slanting * share]), (width, height), interpolation=cv2.INTER_LINEAR)


def blended(plain, steered, found):
    """Estimates that follow the edges as far as these are clear.

    :param plain: (...) float32, the estimates where there is none
    :param steered: (DIRECTIONS, ...) float32, those along each direction
    :param found: (..., 2) float32, as edges() returns it
    :return: (...) float32
    """
    result = plain.copy()
    for one, other, vector in ((0, 2, found[..., 0]), (1, 3, found[..., 1])):
        result += np.where(vector > 0, steered[one] - plain, plain - steered[other]) * vector
    return result
