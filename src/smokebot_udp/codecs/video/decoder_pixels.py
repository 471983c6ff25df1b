# SPDX-License-Identifier: BSD-3-Clause
"""The pixels of a decoded image, out of the memory that the decoding process writes."""
from typing import Sequence

import numpy as np

from ...arrays import Buffer, UInt8Array
from .decoder_memory import Answer, Plane, check_fit, layout
from .decoder_request import Request
from .planes import GREY, from_planes

COLOUR = 'bgr8'
"""Encoding of colour images. For others the caller exchanges the channels."""


def pixels(memory: Buffer, answer: Answer, request: Request) -> UInt8Array:
    """Copy an image out of the shared memory.

    :param memory: (decoder_memory.SIZE,) byte
    :param answer: with Status.DECODED; it comes from a process that is not trusted
    :return: (height, width) uint8, or (height, width, 3) uint8: blue, green and red
    :raises ValueError: the answer is impossible for this request
    """
    check_fit(request, answer.height, answer.width)
    planes = layout(answer.height, answer.width, answer.lines if request.colour else answer.lines[:1])
    if not request.colour:
        return from_planes(_lines(memory, planes[0]).copy(), request.height, request.width, GREY)
    return from_planes(_i420(memory, planes), request.height, request.width, COLOUR)


def _lines(memory: Buffer, plane: Plane) -> UInt8Array:
    """(height, width) uint8, a view."""
    lines = np.frombuffer(memory, np.uint8, plane.height * plane.line, plane.start)
    view: UInt8Array = lines.reshape(plane.height, plane.line)[:, :plane.width]
    return view


def _i420(memory: Buffer, planes: Sequence[Plane]) -> UInt8Array:
    """(3 * height // 2, width) uint8: the three planes without gaps, as OpenCV takes them."""
    i420: UInt8Array = np.concatenate([_lines(memory, plane).ravel() for plane in planes])
    return i420.reshape(-1, planes[0].width)
