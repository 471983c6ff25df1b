# SPDX-License-Identifier: BSD-3-Clause
"""The error of an image as one byte: how good it is once a layer is restored.

The scale is logarithmic, eleven steps to a factor of two, so a byte is within 3.2 % (0.28 dB) of the error.
"""
import math

EXACT = 0
"""The byte of an image without error."""

STEPS = 11
"""Steps to a factor of two."""

SMALLEST = -6
"""log2 of the root mean square error of byte 1 [count]; byte 255 is above any error of 16 bits."""


UNKNOWN = 255
"""The byte of an error that is not known, or too large for any other."""


def to_byte(rms: float) -> int:
    """The byte of a root mean square error.

    :param rms: over all cells, channels included [count]
    :return: EXACT only for 0
    :raises ValueError: rms is negative or not a number
    """
    if not rms >= 0:
        raise ValueError('rms is %r, must be 0 or more' % rms)
    if rms == 0:
        return EXACT
    step = STEPS * (math.log2(rms) - SMALLEST) + 1 if rms < math.inf else math.inf
    return int(min(max(round(min(step, 255.0)), 1), 255))


def from_byte(byte: int) -> float:
    """The root mean square error of a byte [count].

    :raises ValueError: byte is not in 0..255
    """
    if not 0 <= byte <= 255:
        raise ValueError('byte is %r, must be from 0 to 255' % byte)
    return 0.0 if byte == EXACT else 2.0 ** (SMALLEST + (byte - 1) / STEPS)
