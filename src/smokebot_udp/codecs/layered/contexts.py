# SPDX-License-Identifier: BSD-3-Clause
"""The contexts of a band's symbols, and what their probabilities are at first."""
import numpy as np

from ...arrays import Array

ACTIVITIES = 48
"""Activities above count as the highest."""
NEAR_CONTEXT, FAR_CONTEXT, BLOCK_CONTEXT = 0, ACTIVITIES, 2 * ACTIVITIES
REFINEMENT_CONTEXT = BLOCK_CONTEXT + 10
SIGN_CONTEXT = REFINEMENT_CONTEXT + 4
BAND_CONTEXT = SIGN_CONTEXT + 5
CONTEXTS = 128
"""Number of contexts of each band."""

_NEAR = bytes((128, 222, 203, 220, 209, 194, 191, 187, 172, 164, 163, 155, 147, 141, 145, 137, 133, 129))
_FAR = bytes((244, 234, 216, 237, 214, 198, 198, 179, 163, 147, 139, 144, 132))
_BLOCK = bytes((249, 217, 158, 135, 130, 238, 231, 203, 168, 143))
_REFINEMENT = bytes((197, 186, 157, 161))
_SIGN = bytes((128, 122, 125, 119, 114))


def initial_odds(bands: int) -> Array:
    """(bands * CONTEXTS,) uint32 as the range coder has them, from photographs and thermal images."""
    first = np.full(CONTEXTS, 128, np.uint32)
    for start, values in ((NEAR_CONTEXT, _NEAR), (FAR_CONTEXT, _FAR), (BLOCK_CONTEXT, _BLOCK),
                          (REFINEMENT_CONTEXT, _REFINEMENT), (SIGN_CONTEXT, _SIGN)):
        first[start:start + len(values)] = np.frombuffer(values, np.uint8)
    return np.tile(first << 24 | first << 8, bands)
