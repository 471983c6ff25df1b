# SPDX-License-Identifier: BSD-3-Clause
"""Runs the operator's side of an action stream: an action server for the operator's nodes, which the robot's serves."""
import functools
import time
from typing import Any, Callable, Dict, List, Mapping, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

from ..limited_log import ERROR_PERIOD, logwarn
from ..monitoring.stats import StreamStats
from ..serialised import deserialised, serialised
from ..streams.action.goal_watch import GoalWatch, Lost
from ..streams.action.missing_goals import MissingGoals
from ..streams.frame_prefix import add_prefix, strip_prefix
from .action_channels import CANCEL, FINAL, GOAL, PURSUED, ActionStream, ended
from .channel import ChannelListener
from .common import operator_topic
from .logging import log_error
from .way import OperatorWay
from .worker import DeadlineWorker

ANSWER_TIME = 2.0
"""A goal is lost if no status shows it for this time after `max_age` [s]."""

NOBODY = 'no robot is connected'


class OperatorAction(ActionStream):
    """Sends goals and cancellations to the robot, and publishes its status, feedback and results.

    A goal that the robot does not take up ends with a result that says why. After `close` the robot goes on with its
    goals.

    :param name: of the stream in streams.yaml
    :param settings: {name: value}, checked
    :param way: carries all of it
    """

    def __init__(self, name: str, settings: Mapping[str, Any], way: OperatorWay) -> None:
        super().__init__(name, operator_topic(settings['operator_action']), settings, way)
        self._prefix = way.frame_prefix
        self._watch = GoalWatch(self._max_age + ANSWER_TIME)
        self._missing = MissingGoals()
        self._worker: DeadlineWorker[Lost] = DeadlineWorker(
            name, self._watch.poll, self._watch.deadline, self._lose, log_error("stream '%s'" % name))
        self._unknown = False       # whether the robot's node lacks this action

    def start(self) -> None:
        """Offer the action."""
        outputs: Dict[str, Callable[[Any], None]] = {
            '/status': self._status, '/feedback': self._feedback, '/result': self._result}
        # not latched: who starts while the robot is out of reach must not find its action server
        self._publish(*outputs)
        self._open_channels({
            '/goal': ChannelListener(joined=self._joined, unknown=self._lacks),
            **{part: ChannelListener(received=functools.partial(self._received, part, take))
               for part, take in outputs.items()}})
        self._opened.started(self._worker)
        self._subscribe({'/goal': self._goal, '/cancel': self._cancel})

    def stats(self) -> StreamStats:
        """What the stream did, for diagnostics: results that came, goals that left."""
        return StreamStats(self._results, self._goals, steady=False, to_robot=True, dropped=dict(self._dropped),
                           connections=self._link.connections(sending=True))

    def _goal(self, message: Any) -> None:
        self._goals += 1
        status, why = GoalStatus.LOST, NOBODY
        try:
            sent = self._channels['/goal'].send(GOAL + serialised(strip_prefix(message, self._prefix)))
        except ValueError as error:
            sent, status, why = False, GoalStatus.REJECTED, str(error)
        with self._worker.changing():
            if sent:
                self._watch.sent(message.goal_id.id, message.goal_id.stamp.to_sec(), time.monotonic())
            else:
                why += _replaced(self._watch.failed(time.monotonic()))
        if not sent:
            self._end(message.goal_id, status, why)

    def _cancel(self, message: Any) -> None:
        with self._worker.changing():
            self._watch.cancelled(message.id, message.stamp.to_sec(), time.monotonic())
        self._send_cancel(message)

    def _send_cancel(self, message: Any) -> None:
        self._channels['/goal'].send(CANCEL + serialised(message))

    def _lose(self, lost: Lost) -> None:
        """Tell the client of a goal that the robot does not have, as far as is known."""
        reason = 'the goal was not taken up within %g s: %s%s' % (
            self._watch.timeout, self._silence(), _replaced(lost.replaced))
        logwarn("stream '%s'" % self.name, reason, ERROR_PERIOD)
        self._end(GoalID(id=lost.goal), GoalStatus.LOST, reason)

    def _silence(self) -> str:
        """Why nothing is heard of a goal."""
        if not self._link.peers():
            return NOBODY
        if self._unknown:
            return "the robot has no stream '%s' of type action and of this action type" % self.name
        return 'no status of the action server has it'

    def _end(self, goal_id: Any, status: int, text: str) -> None:
        self._publishers['/result'].publish(ended(self._types, goal_id, status, text, rospy.Time.now()))

    def _received(self, part: str, take: Callable[[Any], None], peer: str, data: bytes) -> None:
        """Take a message of the robot, in the link's thread."""
        try:
            message = deserialised(getattr(self._types, part[1:]), data)
        except ValueError:
            self._dropped['malformed'] += 1
            return
        self._unknown = False
        take(message)
        self._publishers[part].publish(add_prefix(message, self._prefix))

    def _status(self, message: Any) -> None:
        """Note which goals the robot has, and cancel those that are lost for their clients, or were cancelled in vain.

        Goals that are on their way are added, and those whose results are.
        """
        statuses, now = {status.goal_id.id: status for status in message.status_list}, time.monotonic()
        final = _with(statuses, FINAL)
        with self._worker.changing():
            self._watch.heard(statuses)
            self._watch.ended(final)
            cancelled = self._watch.to_cancel(_with(statuses, PURSUED), now)
            on_their_way = self._watch.unheard
            missing = self._missing.update(statuses, final, now)
            self._watch.ended(missing.lost)
        # for a client that has cancelled its goal, a status without the goal means that it is lost
        message.status_list += [GoalStatus(goal_id=GoalID(id=goal), status=GoalStatus.PENDING) for goal in on_their_way]
        message.status_list += missing.added
        for goal in cancelled:
            logwarn("stream '%s'" % self.name, 'a goal that nobody follows any more is cancelled: %s' % goal,
                    ERROR_PERIOD)
            self._send_cancel(GoalID(id=goal))
        for goal in missing.lost:
            self._end(GoalID(id=goal), GoalStatus.LOST, 'its result has not come from the robot')

    def _feedback(self, message: Any) -> None:
        with self._worker.changing():
            self._watch.heard([message.status.goal_id.id])

    def _result(self, message: Any) -> None:
        self._results += 1
        self._feedback(message)
        with self._worker.changing():
            self._missing.ended(message.status.goal_id.id)
            self._watch.ended([message.status.goal_id.id])

    def _joined(self, peer: str) -> None:
        self._unknown = False

    def _lacks(self, peer: str) -> None:
        self._unknown = True


def _with(statuses: Mapping[str, Any], values: Tuple[int, ...]) -> Dict[str, float]:
    """{goal: stamp of its id} of those with one of these values of actionlib_msgs/GoalStatus."""
    return {goal: status.goal_id.stamp.to_sec() for goal, status in statuses.items() if status.status in values}


def _replaced(goals: List[str]) -> str:
    """What is added to why a goal was not taken up."""
    return '; the robot is told to give up what it was to replace: %s' % ', '.join(goals) if goals else ''
