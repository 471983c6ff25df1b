# SPDX-License-Identifier: BSD-3-Clause
"""Messages of a subscriber that takes any type."""
from typing import Any, Sequence

from genpy import DeserializationError
from rospy import AnyMsg


def class_of(message: Any, classes: Sequence[Any]) -> Any:
    """The one of some classes that a message is of.

    :param message: rospy.AnyMsg, or a message where this node subscribes the topic with its type as well
    :raises ValueError: it is of none of them
    """
    header = message._connection_header or {} if isinstance(message, AnyMsg) else {}
    found = header.get('type', message._type), header.get('md5sum', message._md5sum)
    for class_ in classes:
        if found == (class_._type, class_._md5sum):
            return class_
    raise ValueError('it is %s, must be %s' % (found[0], ' or '.join(class_._type for class_ in classes)))


def read(message: Any, class_: Any) -> Any:
    """The message of a class whose bytes a rospy.AnyMsg has; other messages are returned as they are.

    :raises ValueError: its bytes are not a message of the class
    """
    if not isinstance(message, AnyMsg):
        return message
    try:
        return class_().deserialize(message._buff)
    except (DeserializationError, UnicodeError) as error:
        raise ValueError('it is no %s: %s' % (class_._type, error)) from error
