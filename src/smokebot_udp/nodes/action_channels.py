# SPDX-License-Identifier: BSD-3-Clause
"""The channels of an action stream: which of actionlib's five topics crosses the link how.

* Goals and cancellations share one channel to the robot, in order: a cancellation of all goals must not overtake the
  goal that was sent before it. Older ones than `max_age` are given up: a goal must not arrive when nobody expects it.
* Results must arrive, however late: a client waits for nothing else.
* Of status and feedback only the newest counts. Each is the only message of its channel that waits, and is repeated
  until it is acknowledged or replaced: also the last one before a silence arrives, and nothing piles up.
"""
from typing import Any, Dict, NamedTuple, Optional, Tuple

from actionlib_msgs.msg import GoalStatus

from ..reliable.bounds import Bounds
from ..serialised import deserialised
from ..streams.message_types import ActionTypes
from .reliable_link import TO_OPERATOR, TO_ROBOT, Channel, ReliableLink

MAX_BYTES = 1 << 20
"""Of what waits in a channel."""

RESULT_AGE = 3600.0
"""[s]"""

GOAL, CANCEL = b'g', b'c'
"""The first byte of a message to the robot."""

PURSUED = (GoalStatus.PENDING, GoalStatus.ACTIVE)
"""Of a goal that can be cancelled, and is not."""

FINAL = (GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.REJECTED, GoalStatus.RECALLED,
         GoalStatus.LOST)
"""Of a goal that has ended."""


class ChannelOptions(NamedTuple):
    """Arguments of ReliableLink.channel."""
    direction: str
    type_name: str
    md5: str
    options: Dict[str, Any]

    def open(self, link: ReliableLink, name: str, **callbacks: Any) -> Channel:
        """Begin the channel."""
        return link.channel(name, self.direction, self.type_name, self.md5, **self.options, **callbacks)


def action_channels(types: ActionTypes, max_age: float) -> Dict[str, ChannelOptions]:
    """The channels of an action: {what follows the stream's name: ChannelOptions}."""
    newest = Bounds(messages=1, bytes=MAX_BYTES, age=max_age)
    return {
        '/goal': _options(TO_ROBOT, types.goal, True, Bounds(messages=100, bytes=MAX_BYTES, age=max_age)),
        '/result': _options(TO_OPERATOR, types.result, True, Bounds(messages=100, bytes=MAX_BYTES, age=RESULT_AGE)),
        '/status': _options(TO_OPERATOR, types.status, False, newest),
        '/feedback': _options(TO_OPERATOR, types.feedback, False, newest),
    }


def _options(direction: str, message_class: Any, expedited: bool, bounds: Bounds) -> ChannelOptions:
    return ChannelOptions(direction, message_class._type, message_class._md5sum,
                          {'ordered': True, 'expedited': expedited, 'bounds': bounds})


def read_request(types: ActionTypes, data: bytes) -> Optional[Tuple[bytes, Any]]:
    """(GOAL or CANCEL, the message) in a message to the robot; None: it is neither."""
    try:
        return data[:1], deserialised({GOAL: types.goal, CANCEL: types.cancel}[data[:1]], data[1:])
    except (KeyError, ValueError):
        return None


def ended(types: ActionTypes, goal_id: Any, status: int, text: str, now: Any) -> Any:
    """A result that says why a goal ended without one of the action server.

    :param status: of actionlib_msgs/GoalStatus
    :param now: its stamp
    """
    result = types.result()
    result.header.stamp = now
    result.status.goal_id, result.status.status, result.status.text = goal_id, status, text
    return result
