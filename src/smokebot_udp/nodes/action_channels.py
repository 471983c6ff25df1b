# SPDX-License-Identifier: BSD-3-Clause
"""What both sides of an action stream share: which of actionlib's five topics crosses the link how.

* Goals and cancellations share one channel to the robot, in order: a cancellation of all goals must not overtake the
  goal that was sent before it. Older ones than `max_age` are given up: a goal must not arrive when nobody expects it.
* Results must arrive, however late: a client waits for nothing else.
* Of status and feedback only the newest counts. Each is the only message of its channel that waits, and is repeated
  until it is acknowledged or replaced: also the last one before a silence arrives, and nothing piles up.
"""
import collections
from typing import Any, Callable, Counter, Dict, Mapping, Tuple

import rospy
from actionlib_msgs.msg import GoalStatus

from ..reliable.bounds import Bounds
from ..serialised import deserialised
from ..streams.message_types import ActionTypes, action_types
from ..streams.relay.parameters import TO_OPERATOR, TO_ROBOT
from .channel import NO_LISTENER, Channel, ChannelKind, ChannelListener
from .way import Way, WayBackStream

QUEUE = 100
"""Queue size of the publishers and subscribers of the action's topics [messages]."""

MAX_BYTES = 1 << 20
"""Maximum size of all messages that wait in a channel [byte]."""

RESULT_AGE = 3600.0
"""Maximum age of a result that waits [s]."""

GOAL, CANCEL = b'g', b'c'
"""The first byte of a message to the robot."""

PURSUED = (GoalStatus.PENDING, GoalStatus.ACTIVE)
"""Statuses of a goal that has not ended and is not being cancelled."""

FINAL = (GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.REJECTED, GoalStatus.RECALLED,
         GoalStatus.LOST)
"""Statuses of a goal that has ended."""


def action_channels(name: str, types: ActionTypes, max_age: float) -> Dict[str, ChannelKind]:
    """The channels of an action: {what follows the stream's name: ChannelKind}."""
    def kind(part: str, direction: str, messages: int, age: float, expedited: bool = False) -> ChannelKind:
        message_class = getattr(types, part[1:])
        return ChannelKind(name + part, direction, message_class._type, message_class._md5sum, expedited=expedited,
                           bounds=Bounds(messages, MAX_BYTES, age))
    return {'/goal': kind('/goal', TO_ROBOT, 100, max_age, expedited=True),
            '/result': kind('/result', TO_OPERATOR, 100, RESULT_AGE, expedited=True),
            '/status': kind('/status', TO_OPERATOR, 1, max_age),
            '/feedback': kind('/feedback', TO_OPERATOR, 1, max_age)}


class ActionStream(WayBackStream):
    """An action stream on one side.

    :param name: of the stream in streams.yaml
    :param topic: of the action on this side, resolved
    :param settings: {name: value}, checked
    :param way: carries all of it
    """

    def __init__(self, name: str, topic: str, settings: Mapping[str, Any], way: Way) -> None:
        super().__init__(name, topic, settings)
        self._types = action_types(settings['action_type'])
        self._link, self._max_age = way.reliable, settings['max_age']
        self._dropped: Counter[str] = collections.Counter()
        self._goals = self._results = 0
        self._channels: Dict[str, Channel] = {}     # made by start(), as are these
        self._publishers: Dict[str, Any] = {}

    def _publish(self, *parts: str) -> None:
        """Publish topics of the action."""
        for part in parts:
            self._publishers[part] = self._opened.topic(rospy.Publisher(
                self.topic + part, getattr(self._types, part[1:]), queue_size=QUEUE, tcp_nodelay=True))

    def _subscribe(self, callbacks: Mapping[str, Callable[[Any], None]]) -> None:
        """Subscribe topics of the action."""
        for part, callback in callbacks.items():
            self._opened.topic(rospy.Subscriber(self.topic + part, getattr(self._types, part[1:]), callback,
                                                queue_size=QUEUE, tcp_nodelay=True))

    def _open_channels(self, listeners: Mapping[str, ChannelListener]) -> None:
        """Begin all channels."""
        for part, kind in action_channels(self.name, self._types, self._max_age).items():
            self._channels[part] = self._opened.add(self._link.channel(kind, listeners.get(part, NO_LISTENER)))


def read_request(types: ActionTypes, data: bytes) -> Tuple[bytes, Any]:
    """(GOAL or CANCEL, the message) in a message to the robot.

    :raises ValueError: it is neither
    """
    class_ = {GOAL: types.goal, CANCEL: types.cancel}.get(data[:1])
    if class_ is None:
        raise ValueError('it is neither a goal nor a cancellation')
    return data[:1], deserialised(class_, data[1:])


def ended(types: ActionTypes, goal_id: Any, status: int, text: str, now: Any) -> Any:
    """A result that says why a goal ended without one of the action server.

    :param status: of actionlib_msgs/GoalStatus
    :param now: its stamp
    """
    result = types.result()
    result.header.stamp = now
    result.status.goal_id, result.status.status, result.status.text = goal_id, status, text
    return result
