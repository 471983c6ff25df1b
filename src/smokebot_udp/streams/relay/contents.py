# SPDX-License-Identifier: BSD-3-Clause
"""What the messages of one topic are about: newer content takes the place of older content of its name, and no other.

Many topics carry more than one thing: the transforms of many frames, the diagnostics of many devices, the ranges of
eight sonars, all from one node or from several. So each message has a name, or is an array of parts that have names.
Where several sources report states again and again, only the newest of each is worth sending, and they take turns.
"""
import collections
import copy
import math
from typing import Any, Callable, Dict, Hashable, Iterable, List, Mapping, NamedTuple, Optional, OrderedDict, Tuple

from ...frame_names import frame_name
from ...serialised import serialised

QUEUE = 100
"""Queue size of subscribers: small messages of many publishers."""

MAX_CONTENTS = 1000
"""Limit of Contents, because they come from the network."""

DELETE_ALL = 3
"""Action of a visualization_msgs/Marker: what came before it is not shown any more."""


class _Kind(NamedTuple):
    """What distinguishes the contents of messages of one type."""
    name: Callable[[Any, str], Hashable]
    """f(part, publisher): unique in the topic, as its subscribers take it"""
    parts: Optional[str] = None
    """The field with the parts; None: the message is the only one."""
    cut: bool = False
    """Whether parts may be sent in any messages, those of several publishers in one."""
    ends: Callable[[Any], bool] = lambda part: False
    """f(part): whether all that came before it is of no use"""


def _frame(message: Any, publisher: str) -> Hashable:
    return publisher, frame_name(message.header.frame_id) if message._has_header else ''


def _child(transform: Any, publisher: str) -> Hashable:
    # tf2: a frame has one parent, whoever says so
    return frame_name(transform.child_frame_id)


def _status(status: Any, publisher: str) -> Hashable:
    return publisher, status.name, status.hardware_id


def _joints(state: Any, publisher: str) -> Hashable:
    return (publisher, *state.name)


def _marker(marker: Any, publisher: str) -> Hashable:
    return (marker.ns, marker.id) if marker.action != DELETE_ALL else DELETE_ALL


def _ends(marker: Any) -> bool:
    return bool(marker.action == DELETE_ALL)


OTHER = _Kind(_frame)
KINDS: Mapping[str, _Kind] = {
    'tf2_msgs/TFMessage': _Kind(_child, 'transforms', cut=True),
    'tf/tfMessage': _Kind(_child, 'transforms', cut=True),
    'diagnostic_msgs/DiagnosticArray': _Kind(_status, 'status'),
    'visualization_msgs/MarkerArray': _Kind(_marker, 'markers', ends=_ends),
    'visualization_msgs/Marker': _Kind(_marker, ends=_ends),
    'sensor_msgs/JointState': _Kind(_joints),
}
"""{message type: its kind}; all others are OTHER"""


class _Content(NamedTuple):
    whole: Any
    """The message that it came in."""
    part: Any
    """The message itself where it has no parts."""


class Contents:
    """The newest content of each name, of at most MAX_CONTENTS names.

    :param message_class: of the messages
    """

    def __init__(self, message_class: Any) -> None:
        self.replaced = 0
        """Parts, or messages without parts, in whose place newer ones came."""
        self._class, self._kind = message_class, KINDS.get(message_class._type, OTHER)
        self._found: OrderedDict[Hashable, _Content] = collections.OrderedDict()

    @property
    def empty(self) -> bool:
        """Whether there is none."""
        return not self._found

    @property
    def cut(self) -> bool:
        """Whether `messages` fit a size: they are independent of each other then."""
        return self._kind.cut

    def add(self, message: Any, publisher: str = '') -> str:
        """Take a message. New names come last, known ones keep their places.

        :return: empty; or, where there are more than MAX_CONTENTS names, what is left out: all others are taken
        """
        parts = [message] if self._kind.parts is None else getattr(message, self._kind.parts)
        for number in range(len(parts) - 1, -1, -1):
            if self._kind.ends(parts[number]):
                parts = parts[number:]
                self._found.clear()
                break
        return self._take((self._kind.name(part, publisher), _Content(message, part)) for part in parts)

    def update(self, other: 'Contents') -> str:
        """Take all of another one, as if its messages came now; returns as `add`."""
        if any(self._kind.ends(content.part) for content in other._found.values()):
            self._found.clear()
        return self._take(other._found.items())

    def messages(self, room: float) -> List[Any]:
        """All of it, in order, in the messages that it came in; what may be cut in as few as fit.

        :param room: size limit of a serialised message whose parts may be cut [byte]; a single part may exceed it
        """
        if self._kind.cut:
            return self._cut(room)
        groups: Dict[int, List[_Content]] = {}
        for content in self._found.values():
            groups.setdefault(id(content.whole), []).append(content)
        return [self._message(group) for group in groups.values()]

    def merged(self) -> Any:
        """All of it in one message, see `kept_together`."""
        return self._of_parts(self._class(), [content.part for content in self._found.values()])

    def take(self) -> Optional[Any]:
        """What is left of the message that has waited longest; it is forgotten. None: nothing waits."""
        if not self._found:
            return None
        whole = next(iter(self._found.values())).whole
        names = [name for name, content in self._found.items() if content.whole is whole]
        return self._message([self._found.pop(name) for name in names])

    def _take(self, contents: Iterable[Tuple[Hashable, _Content]]) -> str:
        refused: Hashable = None
        for name, content in contents:
            if name in self._found:
                self.replaced += self._found[name].whole is not content.whole
            elif len(self._found) >= MAX_CONTENTS:
                refused = refused or name
                continue
            self._found[name] = content
        return '' if refused is None else 'more than %d names in one topic: %s is left out' % (
            MAX_CONTENTS, _text(refused))

    def _message(self, group: List[_Content]) -> Any:
        """The message that these came in, without its other parts."""
        whole = group[0].whole
        if self._kind.parts is None or len(getattr(whole, self._kind.parts)) == len(group):
            return whole
        return self._of_parts(copy.copy(whole), [content.part for content in group])

    def _cut(self, room: float) -> List[Any]:
        messages: List[Any] = []
        left = 0.0
        for content in self._found.values():
            size = size_of(content.part)
            if size > left:
                messages.append(self._of_parts(self._class(), []))
                left = room - size_of(messages[-1])
            getattr(messages[-1], str(self._kind.parts)).append(content.part)
            left -= size
        return messages

    def _of_parts(self, message: Any, parts: List[Any]) -> Any:
        setattr(message, str(self._kind.parts), parts)
        return message


def kept_together(message_class: Any) -> bool:
    """Whether a latched topic's messages make one: nothing but their parts says anything. Of others the last counts."""
    kind = KINDS.get(message_class._type, OTHER)
    return kind.parts is not None and not message_class._has_header


def stamp_of(message: Any) -> Optional[Any]:
    """The stamp of a message, of transforms the newest (rospy.Time); None where the type has none."""
    if hasattr(message, 'transforms'):
        return max((transform.header.stamp for transform in message.transforms), default=None)
    return message.header.stamp if message._has_header else None


def publisher_of(message: Any) -> str:
    """The name of the node that has published a message; empty: unknown."""
    header = getattr(message, '_connection_header', None) or {}
    return str(header.get('callerid', ''))


def size_of(message: Any) -> int:
    """Size of a message when serialised [byte]."""
    return len(serialised(message))


def _text(name: Hashable) -> str:
    return ', '.join(str(part) for part in name if part) if isinstance(name, tuple) else str(name)


class Turns(Contents):
    """Messages that wait for one peer: the one of which a part has waited longest is sent next.

    :param message_class: of the messages
    """

    def __init__(self, message_class: Any) -> None:
        super().__init__(message_class)
        self._next = -math.inf      # when the next one may be sent [s]

    def due(self, packed: Callable[[Any], bytes], rate: float, now: float) -> Optional[bytes]:
        """The message to send now; None: nothing waits, or it is too soon after the last one.

        :param packed: f(message), what is sent of it
        :param rate: what all may take, on average [byte/s]
        :param now: by a steady clock [s]
        """
        message = self.take() if now >= self._next else None
        if message is None:
            return None
        data = packed(message)
        self._next = now + len(data) / rate
        return data
