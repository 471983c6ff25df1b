# SPDX-License-Identifier: BSD-3-Clause
"""Names of array types for annotations.

numpy.typing came with numpy 1.20, Ubuntu 20.04 has 1.17: at run time all of these are np.ndarray. Shapes are in the
docstrings.
"""
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    Array = NDArray[Any]
    BoolArray = NDArray[np.bool_]
    IntArray = NDArray[np.int_]
    FloatArray = NDArray[np.float64]
    Float32Array = NDArray[np.float32]
    UInt8Array = NDArray[np.uint8]
    Records = NDArray[np.void]
else:
    Array = BoolArray = IntArray = FloatArray = Float32Array = UInt8Array = Records = np.ndarray
