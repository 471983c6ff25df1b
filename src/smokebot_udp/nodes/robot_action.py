# SPDX-License-Identifier: BSD-3-Clause
"""Runs the robot's side of an action stream: an action client of the robot's server for all operators."""
import time
from typing import Any, Mapping, Optional, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from ..limited_log import logerr
from ..monitoring.sources import ACTION, Source
from ..monitoring.stats import StreamStats
from ..newest import Newest
from ..serialised import serialised
from ..streams.action.goal_watch import MAX_GOALS
from ..streams.action.throttle import Throttle
from .action_channels import CANCEL, PURSUED, ActionStream, ended, read_request
from .channel import ChannelListener
from .logging import log_error
from .way import RobotWay
from .worker import DeadlineWorker

CANCEL_PERIOD = 0.2
"""While the emergency stop is engaged: goals that go on are cancelled again after this time [s]."""


class RobotAction(ActionStream):
    """Publishes the goals and cancellations of operators, and sends them status, feedback and results.

    Goals are those of the operator who drives; everybody may cancel. The emergency stop cancels all. After `close` the
    action server goes on with its goals.

    :param name: of the stream in streams.yaml
    :param settings: {name: value}, checked
    :param way: carries all of it
    """

    def __init__(self, name: str, settings: Mapping[str, Any], way: RobotWay) -> None:
        super().__init__(name, rospy.resolve_name(settings['robot_action']), settings, way)
        self.source = Source(ACTION, self.topic, self._types.result._type)
        self._control = way.control
        self._stopped = False, 0        # whether the emergency stop is engaged, how often it was released
        self._cancelled = 0.0       # when all goals were cancelled last
        self._senders: Newest[str, str] = Newest(MAX_GOALS)     # {goal that has not ended: operator}
        self._throttles = {part: Throttle(settings['feedback_rate']) for part in ('/status', '/feedback')}
        self._worker: DeadlineWorker[Tuple[str, bytes]] = DeadlineWorker(
            name, self._poll, self._deadline, self._send, log_error("stream '%s'" % name))

    def start(self) -> None:
        """Begin to take goals."""
        self._publish('/goal', '/cancel')
        self._opened.callback(self._publishers.clear)   # the emergency stop may still be engaged
        self._open_channels({'/goal': ChannelListener(received=self._requested)})
        self._opened.started(self._worker)
        self._control.subscribe(self._follow)
        self._subscribe({'/status': self._status, '/feedback': self._feedback, '/result': self._result})

    def stats(self) -> StreamStats:
        """What the stream did, for diagnostics: goals that came, results that left."""
        return StreamStats(self._goals, self._results, steady=False, to_robot=True, dropped=dict(self._dropped),
                           connections=self._link.connections(sending=False))

    def _follow(self) -> None:
        """The emergency stop may have been engaged: it cancels every goal of the action server, whoever sent it."""
        standing, (engaged, releases) = self._control.standing, self._stopped
        self._stopped = standing.estop, standing.releases
        if self._stopped not in ((engaged, releases), (False, releases + engaged)):     # nor was it just released
            self._cancel_all()

    def _cancel_all(self) -> None:
        self._cancelled = time.monotonic()
        if self._publishers:
            self._publishers['/cancel'].publish(GoalID())

    def _cancel_of(self, operator: str) -> str:
        """Cancel the goals of an operator that a refused one was to replace, and nobody follows; in words."""
        goals = [goal for goal, sender in self._senders.items() if sender == operator and goal]
        for goal in goals:
            self._senders.pop(goal)
            self._publishers['/cancel'].publish(GoalID(id=goal))
        return '; what it was to replace is cancelled: %s' % ', '.join(goals) if goals else ''

    def _refusal(self, operator: str) -> Optional[str]:
        """Why a goal of this operator is not published; None: it is."""
        refusal = self._control.standing.refusal(operator)
        if refusal is None and not self._publishers['/goal'].get_num_connections():
            return 'the robot has no action server %s' % self.topic
        return refusal

    def _requested(self, peer: str, data: bytes) -> None:
        """Take a goal or a cancellation of an operator, in the link's thread."""
        try:
            kind, message = read_request(self._types, data)
        except ValueError:
            self._dropped['malformed'] += 1
            return
        if kind == CANCEL:
            self._publishers['/cancel'].publish(message)
            return
        reason = self._refusal(peer)
        if reason is None:
            self._goals += 1
            self._senders[message.goal_id.id] = peer
            self._publishers['/goal'].publish(message)
        else:
            self._dropped['refused'] += 1
            reason += self._cancel_of(peer)
            self._answer(ended(self._types, message.goal_id, GoalStatus.REJECTED, reason, rospy.Time.now()), peer)

    def _status(self, message: Any) -> None:
        """Send a status. While the emergency stop is engaged, also goals end that others send, or sent just then."""
        self._put('/status', message, serialised(GoalStatusArray(status_list=message.status_list)))
        pursued = any(status.status in PURSUED for status in message.status_list)
        if pursued and self._control.standing.estop and time.monotonic() - self._cancelled >= CANCEL_PERIOD:
            self._cancel_all()

    def _feedback(self, message: Any) -> None:
        self._put('/feedback', message, serialised(message))

    def _put(self, part: str, message: Any, content: bytes) -> None:
        with self._worker.changing():
            self._throttles[part].put(serialised(message), content, time.monotonic())

    def _result(self, message: Any) -> None:
        self._results += 1
        self._senders.pop(message.status.goal_id.id, None)
        self._answer(message)

    def _answer(self, result: Any, peer: Optional[str] = None) -> None:
        """Send a result to an operator; None: to all."""
        try:
            self._channels['/result'].send(serialised(result), peer)
        except ValueError as error:
            logerr("stream '%s'" % self.name, 'a result of %s is not sent: %s' % (self.topic, error))

    def _poll(self, now: float) -> Optional[Tuple[str, bytes]]:
        for part, throttle in self._throttles.items():
            data = throttle.poll(now)
            if data is not None:
                return part, data
        return None

    def _deadline(self) -> Optional[float]:
        deadlines = [throttle.deadline() for throttle in self._throttles.values()]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def _send(self, item: Tuple[str, bytes]) -> None:
        part, data = item
        self._channels[part].send(data)
