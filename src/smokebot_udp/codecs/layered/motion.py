# SPDX-License-Identifier: BSD-3-Clause
"""Motion between two images: what displaces the pixels of the one to where they are in the other.

The robot estimates it, and sends its bytes; both sides compensate it, with the same pixels.
"""
from typing import NamedTuple, Tuple

import numpy as np

from ...arrays import Array, IntArray
from . import alignment, mesh_bits, warp
from .differences import flat

LEVEL = 2
"""A mesh has 2^LEVEL cells down and across. Finer ones are hardly better on recordings of robots and drones."""
NODES = (1 << LEVEL) + 1
MAX_BYTES = 120
"""Maximum size of a coded motion [byte]."""
_SHARP, _SMOOTH = range(2)
"""Values of the first byte of a coded motion."""
ROWS = 48
"""Motions are compared by about this number of rows."""
WORTH = 0.99
"""A motion is used where it decreases what is left to code to less than this part."""
SMOOTH_WORTH = 1.0
"""A smooth reference is used where it leaves less than this part of what a sharp one leaves: its own noise is not
left."""


class Motion(NamedTuple):
    """Displacements of a reference."""
    nodes: IntArray
    """(NODES, NODES, 2) int16: of the nodes of a mesh (warp.py), down and right [1/32 pixel]; (0, 0, 2): no
    motion"""
    smooth: bool
    """Whether the reference is interpolated by B-splines, which also remove noise; else by Catmull-Rom's filter."""

    def __bool__(self) -> bool:
        """Whether anything moves."""
        return len(self.nodes) > 0


NONE = Motion(np.zeros((0, 0, 2), np.int16), False)
"""The reference as it is."""


def to_bytes(motion: Motion) -> bytes:
    """Bytes of a motion, at most MAX_BYTES of one that `estimate` found; none of NONE."""
    return bytes([_SMOOTH if motion.smooth else _SHARP]) + mesh_bits.write(motion.nodes) if motion else b''


def from_bytes(data: bytes) -> Motion:
    """The motion that `to_bytes` wrote.

    :raises ValueError: these are not the bytes of a motion
    """
    if not data:
        return NONE
    if len(data) > MAX_BYTES or data[0] not in (_SHARP, _SMOOTH):
        raise ValueError('%d bytes of motion, of kind %d' % (len(data), data[0]))
    motion = Motion(mesh_bits.read(data[1:], LEVEL).astype(np.int16), data[0] == _SMOOTH)
    if to_bytes(motion) != data:
        raise ValueError('bytes of motion that are not written like this')
    return motion


def compensate(reference: Array, motion: Motion) -> Array:
    """The displaced reference, bit-identical on every machine; itself, with NONE.

    :param reference: (height, width) uint8 or uint16, or (height, width, 3) uint8
    """
    if not motion:
        return reference
    source = flat(reference)
    result = np.empty_like(source)
    warp.warp(source, _size(reference), motion.nodes, _filters(motion.smooth), _most(reference), result)
    return result.reshape(reference.shape)


def estimate(reference: Array, image: Array) -> Motion:
    """The motion that makes an image from a reference; NONE where it is hardly better than the reference as it is.

    :param reference: as of compensate
    :param image: of the same shape and type
    """
    if min(image.shape[:2]) < alignment.LEAST_SIDE:
        return NONE
    nodes = np.rint(alignment.aligned(reference, image, LEVEL) * warp.NODE_UNITS)
    sharp = Motion(np.clip(nodes, -mesh_bits.LIMIT, mesh_bits.LIMIT).astype(np.int16), False)
    smooth = sharp._replace(smooth=True)
    still, sharp_rest, smooth_rest = (_rest(reference, motion, image) for motion in (NONE, sharp, smooth))
    if sharp_rest >= WORTH * still or len(to_bytes(sharp)) > MAX_BYTES:
        return NONE
    return smooth if smooth_rest < SMOOTH_WORTH * sharp_rest else sharp


def _rest(reference: Array, motion: Motion, image: Array) -> float:
    """What is left to code of some rows of an image, as far as one motion can be compared with another.

    That is what it differs by within a few pixels: bytes hardly depend on what is wide, such as brightness and drift.
    Roots are added: a few large differences cost less than many small ones.
    """
    return float(warp.roughness(flat(reference), _size(reference), motion.nodes, _filters(motion.smooth),
                                _most(reference), flat(image), max(len(image) // ROWS, 1)))


def _size(pixels: Array) -> Tuple[int, int, int]:
    return pixels.shape[0], pixels.shape[1], 1 if pixels.ndim == 2 else pixels.shape[2]


def _filters(smooth: bool) -> IntArray:
    return (warp.SMOOTH if smooth else warp.SHARP).reshape(-1)


def _most(pixels: Array) -> int:
    return int(256 ** pixels.itemsize - 1)
