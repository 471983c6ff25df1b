# SPDX-License-Identifier: BSD-3-Clause
"""Whether a command asks for nothing: it is the type's zero value, apart from headers."""
from typing import Any


def is_zero(value: Any) -> bool:
    """Whether all fields of a ROS message are zero, empty, or full of zeros.

    :param value: a message, or the value of a field
    """
    if getattr(value, '_type', None) == 'std_msgs/Header':
        return True
    if isinstance(value, (list, tuple, bytes)):
        return all(map(is_zero, value))
    slots = getattr(value, '__slots__', None)
    if slots is not None:
        return all(is_zero(getattr(value, slot)) for slot in slots)
    return not value
