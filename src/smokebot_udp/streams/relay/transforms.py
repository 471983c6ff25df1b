# SPDX-License-Identifier: BSD-3-Clause
"""Shared by both sides of relay streams: transforms merged by pair of frames."""
import io
from typing import Any, Dict, List, Optional, Tuple

TF_TYPES = ('tf2_msgs/TFMessage', 'tf/tfMessage')
"""Message types whose transforms are merged."""

QUEUE = 100
"""Queue size of subscribers: small messages of many publishers."""

MAX_PAIRS = 1000
"""Limit of a TransformSet, because its content comes from the network."""


class TransformSet:
    """The newest transform of each pair of frames, of at most MAX_PAIRS pairs."""

    def __init__(self) -> None:
        self._transforms: Dict[Tuple[str, str], Any] = {}    # {(parent, child): TransformStamped}

    @property
    def transforms(self) -> List[Any]:
        """In the order in which their pairs were first seen: [geometry_msgs/TransformStamped, ...]."""
        return list(self._transforms.values())

    def add(self, message: Any) -> None:
        """Take the transforms of a TFMessage, or of another set.

        :raises ValueError: where there are more than MAX_PAIRS pairs; the transforms of all other pairs are taken
        """
        refused = None
        for transform in message.transforms:
            pair = transform.header.frame_id, transform.child_frame_id
            if pair in self._transforms or len(self._transforms) < MAX_PAIRS:
                self._transforms[pair] = transform
            else:
                refused = refused or pair
        if refused:
            raise ValueError('more than %d pairs of frames: %s to %s is left out' % ((MAX_PAIRS,) + refused))

    def messages(self, class_: Any, room: float) -> List[Any]:
        """All transforms, in the order in which their pairs were first seen, grouped into messages.

        :param class_: class of the messages
        :param room: size limit of a serialised message [byte]; a single transform may exceed it
        """
        messages: List[Any] = []
        left = 0.0
        for transform in self._transforms.values():
            size = size_of(transform)
            if size > left:
                messages.append(class_())
                left = room - size_of(messages[-1])
            messages[-1].transforms.append(transform)
            left -= size
        return messages


def stamp_of(message: Any) -> Optional[Any]:
    """The stamp of a message, of transforms the newest (rospy.Time); None where the type has none."""
    if hasattr(message, 'transforms'):
        return max((transform.header.stamp for transform in message.transforms), default=None)
    return message.header.stamp if message._has_header else None


def size_of(message: Any) -> int:
    """Size of a message when serialised [byte]."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.tell()
