# SPDX-License-Identifier: BSD-3-Clause
"""Compile the loops ahead: `python3 -m smokebot_udp.codecs.layered.compile` fills numba's cache, in about 20 s.

With --check it only says by its exit status whether the cache is filled: 0, else 1.
"""
import os
import sys
from typing import Any

from .cache import compiled, locked, remember

__all__ = ['compile_all', 'compiled']


def compile_all() -> None:
    """Run all loops once with each kind of image and tile; numba compiles them, or takes them from its cache."""
    import numpy as np

    from ..perception import ground, voxel
    from ..tiles import coder
    from . import depth, differences, erasure, image, plan
    for pixels in (np.zeros((40, 40), np.uint8), np.zeros((40, 40), np.uint16), np.zeros((40, 40, 3), np.uint8)):
        pixels[5:, 7:] = 200
        for lossless in (False, True):
            stream = image.encode(pixels, lossless, 1 << 20, np.zeros((40, 40), np.uint8))
            stream = image.encode(pixels, lossless, 1 << 20, np.zeros((40, 40), np.uint8), pixels[::-1])
            image.decode(stream.data, 40, 40, 3 if pixels.ndim == 3 else 1, pixels.itemsize, pixels[::-1])
            stream.prefixes.pixels(len(stream.data))
        _compile_motion(pixels)
        differences.entropy(pixels, pixels)
        differences.mean_square(pixels, pixels)
    plan.best_plan(stream.ends, plan.worth(stream.errors, stream.cells, None), 4000, {0.1: 1.0}, None, 100, 1300)
    depth.to_counts(np.full((2, 2), np.nan, np.float32), 1.0)
    erasure.extend(np.zeros((2, 9), np.uint8), 3)
    random = np.random.RandomState(1)
    cloud = random.rand(100, 3).astype(np.float32)
    voxel.filter_by_loops(cloud, 0.1)
    ground.fit_by_loops(cloud, 0.1, random)
    for value in (100, 50):
        tile = coder.encode(np.array([[0, value]], np.int8), 100)
        coder.decode(np.frombuffer(tile or b'', np.uint8), 1, 2)


def _compile_motion(pixels: Any) -> None:
    """The loops that find a motion, displace images of this type by it, with either filter, and blend them.

    :param pixels: an image of this type
    """
    import numpy as np

    from . import blend, motion
    coarse = np.random.RandomState(1).randint(0, 200, (12, 16, *pixels.shape[2:])).astype(pixels.dtype)
    scene = coarse.repeat(8, axis=0).repeat(8, axis=1)
    large = scene.repeat(4, axis=0).repeat(4, axis=1)
    motion.estimate(large, large)
    motion.estimate(scene, np.ascontiguousarray(np.roll(scene, 3, axis=1)))
    for smooth in (False, True):
        other = motion.compensate(scene, motion.Motion(np.full((2, 2, 2), 40, np.int16), smooth))
    blend.blended(scene, other, blend.share_of(scene, other, scene))


def main(*arguments: str) -> int:
    """Fill the cache, unless it is filled, at the lowest priority: nodes may be running."""
    if '--check' in arguments:
        return 0 if compiled() else 1
    os.nice(19)
    with locked():
        if not compiled():
            compile_all()
            remember()
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
