# SPDX-License-Identifier: BSD-3-Clause
"""A prefix of all frames of a robot, such as `ugv1/`: the frames of several robots at one desk do not clash.

It goes before the frame_id and child_frame_id of a message and of all messages in it. An empty frame stays empty. A
frame that has the prefix already gets no second one, so a robot's own frames must not begin with its prefix. Frames and
prefix are taken by their names, without a slash at the beginning, see frame_names.
"""
import functools
from typing import Any, Callable, List, Optional, Tuple

from genpy.message import get_message_class

from ..frame_names import frame_name

FIELDS = frozenset(['frame_id', 'child_frame_id'])
"""Strings of these names are frames."""

Rename = Callable[[str], str]
"""f(frame) -> frame"""

Rewrite = Callable[[Any, Rename], Any]
"""f(value of a field, rename) -> value; the same object where nothing differs."""


def add_prefix(message: Any, prefix: str) -> Any:
    """A message whose frames have the prefix.

    :param message: of any type; it is not changed, and the result shares with it what has no frames
    """
    return _rewritten(message, lambda frame: with_prefix(frame, prefix)) if prefix else message


def strip_prefix(message: Any, prefix: str) -> Any:
    """A message whose frames lack the prefix: the reverse of add_prefix. Frames without the prefix stay."""
    return _rewritten(message, lambda frame: _without_prefix(frame, prefix)) if prefix else message


def with_prefix(frame: str, prefix: str) -> str:
    """A frame with the prefix."""
    name, prefix = frame_name(frame), frame_name(prefix)
    return name if not name or name.startswith(prefix) else prefix + name


def _without_prefix(frame: str, prefix: str) -> str:
    name, prefix = frame_name(frame), frame_name(prefix)
    return name[len(prefix):] if name.startswith(prefix) else frame


def _rewritten(message: Any, rename: Rename) -> Any:
    class_: Any = type(message)
    rewrite = _message_rewrite(class_)
    return rewrite(message, rename) if rewrite else message


@functools.lru_cache(maxsize=None)
def _message_rewrite(class_: Any) -> Optional[Rewrite]:
    """How the frames of a message of this class are rewritten; None: it cannot have any."""
    found: List[Tuple[str, Rewrite]] = []
    for name, type_ in zip(class_.__slots__, class_._slot_types):
        rewrite = _field_rewrite(name, type_)
        if rewrite:
            found.append((name, rewrite))
    return functools.partial(_rewrite_message, found) if found else None


def _field_rewrite(name: str, type_: str) -> Optional[Rewrite]:
    """How a field is rewritten; None: it has no frames.

    :param type_: as in a message definition, such as string or geometry_msgs/TransformStamped[]
    """
    if type_ == 'string':
        return _rewrite_frame if name in FIELDS else None
    element, _, array = type_.partition('[')
    if '/' not in element:
        return None     # numbers, times
    rewrite = _message_rewrite(get_message_class(element))
    return functools.partial(_rewrite_array, rewrite) if rewrite and array else rewrite


def _rewrite_frame(frame: str, rename: Rename) -> str:
    return rename(frame)


def _rewrite_message(fields: List[Tuple[str, Rewrite]], message: Any, rename: Rename) -> Any:
    class_: Any = type(message)
    changed = class_.__new__(class_)    # copy.copy takes ten times as long
    for name in class_.__slots__:
        setattr(changed, name, getattr(message, name))
    for name, rewrite in fields:
        setattr(changed, name, rewrite(getattr(message, name), rename))
    return changed


def _rewrite_array(rewrite: Rewrite, messages: Any, rename: Rename) -> List[Any]:
    return [rewrite(message, rename) for message in messages]
