# SPDX-License-Identifier: BSD-3-Clause
"""Compensation as doc/motion.md has it, in Python's integers; and scenes that move."""
from typing import Any, List

import numpy as np

from smokebot_udp.arrays import Array, FloatArray


def weights(phase: int, smooth: bool) -> List[int]:
    """Weights of four pixels in a row, in 128ths. The second one is `phase` 64ths before the place."""
    exact = []
    for i in range(-1, 3):
        x = abs(i - phase / 64)
        if smooth:
            value = 2 / 3 - x * x + x ** 3 / 2 if x < 1 else (2 - x) ** 3 / 6
        else:
            value = 1.5 * x ** 3 - 2.5 * x * x + 1 if x < 1 else -0.5 * x ** 3 + 2.5 * x * x - 4 * x + 2
        exact.append(128 * value)
    rounded = [int(np.rint(value)) for value in exact]
    rounded[rounded.index(max(rounded))] += 128 - sum(rounded)
    return rounded


def place(i: int, size: int, cells: int) -> Any:
    at = i * cells * 256 // max(size - 1, 1)
    cell = min(at // 256, cells - 1)
    return cell, at - 256 * cell


def displacement(nodes: Array, y: int, x: int, height: int, width: int) -> Any:
    """Displacement of the pixel (y, x) [1/64 pixel]."""
    begin = x - x % 4
    row, below = place(y, height, len(nodes) - 1)
    cell, behind = place(begin + min(4, width - begin) // 2, width, len(nodes) - 1)
    corners = nodes[row:row + 2, cell:cell + 2].astype(int)
    upper, lower = corners[0, 0] * (256 - behind) + corners[0, 1] * behind, (
        corners[1, 0] * (256 - behind) + corners[1, 1] * behind)
    return (upper * (256 - below) + lower * below + (1 << 14)) >> 15


def compensated(pixels: Array, nodes: Array, smooth: bool) -> Array:
    """As motion.compensate."""
    height, width = pixels.shape[:2]
    result = np.empty_like(pixels)
    for y in range(height):
        for x in range(width):
            down, right = displacement(nodes, y, x, height, width)
            rows = np.clip(y + (down >> 6) + np.arange(-1, 3), 0, height - 1)
            columns = np.clip(x + (right >> 6) + np.arange(-1, 3), 0, width - 1)
            patch = pixels[rows][:, columns].astype(int)
            sums = np.tensordot(np.outer(weights(down & 63, smooth), weights(right & 63, smooth)), patch, 2)
            result[y, x] = np.clip((sums + (1 << 13)) >> 14, 0, 256 ** pixels.itemsize - 1)
    return result


def scene(y: FloatArray, x: FloatArray) -> FloatArray:
    """Texture of all scales, 0 to 1, at any places."""
    random = np.random.RandomState(5)
    total = np.zeros(np.broadcast(y, x).shape)
    for scale in (90.0, 45.0, 25.0, 14.0, 9.0, 6.0):
        for _ in range(4):
            angle, phase = random.uniform(0, 2 * np.pi, 2)
            total += scale ** 0.7 * np.sin(2 * np.pi / scale * (x * np.cos(angle) + y * np.sin(angle)) + phase)
    return 0.5 + total / 250


def view(height: int, width: int, zoom: float = 1.0, turn: float = 0.0, down: float = 0.0, right: float = 0.0
         ) -> FloatArray:
    """The scene from another place: (height, width), 0 to 1."""
    y, x = np.indices((height, width)) - np.array([height, width]).reshape(2, 1, 1) / 2
    return scene(zoom * (y * np.cos(turn) - x * np.sin(turn)) + down, zoom * (y * np.sin(turn) + x * np.cos(turn))
                 + right)


def psnr(one: Array, other: Array, peak: float = 255.0) -> float:
    return float(10 * np.log10(peak ** 2 / max(np.mean((one.astype(float) - other) ** 2), 1e-9)))
