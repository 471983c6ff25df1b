# SPDX-License-Identifier: BSD-3-Clause
"""GF(256): the polynomial that reduces products, powers and logarithms."""
from typing import Tuple

import numpy as np

from ...arrays import IntArray, UInt8Array

POLYNOMIAL = 0x11d
"""x^8 + x^4 + x^3 + x^2 + 1; 2 generates all elements but 0."""


def _powers_and_logarithms() -> Tuple[UInt8Array, IntArray]:
    """((510,) uint8: powers of 2, twice the cycle; (256,) int: logarithms to base 2, that of 0 is not used)."""
    powers, logarithms = np.zeros(510, np.uint8), np.zeros(256, int)
    element = 1
    for exponent in range(255):
        powers[exponent] = powers[exponent + 255] = element
        logarithms[element] = exponent
        element <<= 1
        if element & 256:
            element ^= POLYNOMIAL
    return powers, logarithms


POWERS, LOGARITHMS = _powers_and_logarithms()
