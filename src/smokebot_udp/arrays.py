# SPDX-License-Identifier: BSD-3-Clause
"""Type aliases for annotations of numpy arrays.

numpy.typing is new in numpy 1.20, and Ubuntu 20.04 has 1.17: at run time all array aliases are np.ndarray. Shapes, and
dtypes where the alias is `Array`, are given in the docstrings.
"""
from typing import TYPE_CHECKING, Any, Union

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
    DType = np.dtype[Any]
    Buffer = Union[bytes, bytearray, memoryview, NDArray[Any]]
else:
    Array = BoolArray = IntArray = FloatArray = Float32Array = UInt8Array = Records = np.ndarray
    DType = np.dtype
    Buffer = Union[bytes, bytearray, memoryview, np.ndarray]
"""Buffer: bytes of a message's field, as rospy or rospy.numpy_msg reads it."""
