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


def deserialised(class_: Any, data: bytes) -> Any:
    """The message, request or response of a class.

    :raises ValueError: the bytes are none
    """
    try:
        return class_().deserialize(data)
    except Exception:   # genpy's readers raise DeserializationError, UnicodeError, ... on hostile bytes
        raise ValueError('it is no %s' % class_._type) from None
