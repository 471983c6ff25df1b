# SPDX-License-Identifier: BSD-3-Clause
"""Commands that ask for nothing: by them a person shows that no stick is pushed.

A command is neutral if each of its values is zero, or what the robot gets when commands stop (on_timeout), or what the
sticks showed when the person said that they were at rest. Headers do not matter. The triggers of many gamepads rest at
1, and show 0 until they are pulled for the first time.

Nothing but the person's word tells a trigger at rest from a stick that is held at its stop, so no value is taken for
rest because it lasts.
"""
from typing import Any, Dict, Iterator, List, Optional, Tuple


class Neutral:
    """Knows the neutral commands of one message type.

    :param on_timeout: what the robot gets when commands stop; None: nothing
    """

    def __init__(self, on_timeout: Any = None) -> None:
        self._known: List[Dict[str, Any]] = [{} if on_timeout is None else dict(values_of(on_timeout)), {}]

    def deviation(self, message: Any) -> Optional[str]:
        """The first value of a command that is not neutral, such as 'axes[1]'; None: it is a neutral command."""
        return next((path for path, value in values_of(message)
                     if value and not any(known.get(path) == value for known in self._known)), None)

    def rests(self, message: Any) -> str:
        """The sticks are at rest now, and show this; returns the values that are not zero, in words."""
        self._known[1] = dict(values_of(message))
        return ', '.join('%s %s' % item for item in self._known[1].items() if item[1]) or 'all zero'


def values_of(value: Any, path: str = '') -> Iterator[Tuple[str, Any]]:
    """(where, value) of the values of a ROS message that have no parts, but for headers.

    :param value: a message, or the value of a field
    """
    if getattr(value, '_type', None) == 'std_msgs/Header':
        return
    if isinstance(value, (list, tuple, bytes)):
        for index, element in enumerate(value):
            yield from values_of(element, '%s[%d]' % (path, index))
        return
    slots = getattr(value, '__slots__', None)
    if slots is None:
        yield path, value
        return
    for slot in slots:
        yield from values_of(getattr(value, slot), '%s.%s' % (path, slot) if path else slot)
