# SPDX-License-Identifier: BSD-3-Clause
"""ROS messages as bytes."""
import io
from typing import Any


def serialised(message: Any) -> bytes:
    """A message, request or response of any type as bytes.

    :raises genpy.SerializationError: where a field has a value of a wrong type
    """
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()
