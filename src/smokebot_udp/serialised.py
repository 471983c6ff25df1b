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


def deserialised(message_class: Any, data: bytes) -> Any:
    """The message, request or response of a class that bytes from the network are.

    :raises ValueError: where they are none
    """
    try:
        return message_class().deserialize(data)
    except Exception:       # genpy's readers raise DeserializationError, UnicodeError, ... on hostile bytes
        raise ValueError('what came is no %s' % message_class._type) from None
