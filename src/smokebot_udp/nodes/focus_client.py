# SPDX-License-Identifier: BSD-3-Clause
"""The operator's switch of the robot's focus over the same lossy link: requested until the robot's status answers."""
import random
import threading
import time
from typing import Any, Dict, Optional, Sequence

import rospy

from ..mission.changes import answer
from ..msg import FocusRequest, RobotStatus
from ..srv import SetFocus, SetFocusResponse
from ..traffic import EXPEDITED
from ..transport import Transport
from .focus import REQUESTS

RETRY_PERIOD = 0.1
"""[s]"""


class FocusClient:
    """Serves ~set_focus on the operator's side.

    :param status_topic: topic on which the operator receives RobotStatus; None where no stream carries it
    :param patience: timeout of a request [s]
    """

    def __init__(self, status_topic: Optional[str], patience: float, transport: Transport) -> None:
        self._status: Any = None
        self._patience = patience
        self._answered = threading.Condition()
        self._one_at_a_time = threading.Lock()
        self._requests = transport.publisher(REQUESTS, FocusRequest, queue_size=1, tos=EXPEDITED)
        self._subscriber: Any = None
        if status_topic:
            self._subscriber = rospy.Subscriber(status_topic, RobotStatus, self._take, queue_size=5)
        rospy.Service('~set_focus', SetFocus, self.serve)

    def _take(self, status: Any) -> None:
        with self._answered:
            self._status = status
            self._answered.notify_all()

    @property
    def status(self) -> Any:
        """The robot's last RobotStatus; None: there was none."""
        with self._answered:
            return self._status

    def sent(self) -> Dict[str, Any]:
        """{stream: StreamStatus}, as the robot reported last."""
        status = self.status
        return {stream.name: stream for stream in status.streams} if status else {}

    def serve(self, asked: Any) -> Any:
        """Serve SetFocus: the response, when the robot has answered."""
        if self._subscriber is None:
            return SetFocusResponse(
                False, 'no answer can arrive: streams.yaml has no relay of smokebot_udp/RobotStatus')
        with self._one_at_a_time:
            request = FocusRequest(id=random.randint(1, 2 ** 32 - 1), focus=asked.focus)
            deadline = time.monotonic() + self._patience
            with self._answered:
                before = self._status.streams if self._status else []
                while self._status is None or self._status.request != request.id:
                    if time.monotonic() > deadline or rospy.is_shutdown():
                        return SetFocusResponse(False, 'the robot did not answer in %g s' % self._patience)
                    self._requests.publish(request)
                    self._answered.wait(RETRY_PERIOD)
                return _response(asked.focus, before, self._status)

    def close(self) -> None:
        """End the subscriptions."""
        self._requests.unregister()
        if self._subscriber is not None:
            self._subscriber.unregister()


def _response(focus: str, before: Sequence[Any], status: Any) -> Any:
    """The response to a request for a focus, by the StreamStatus messages before and the RobotStatus that answers it.
    """
    if status.refusal:
        return SetFocusResponse(False, status.refusal)
    if status.focus != focus:
        return SetFocusResponse(False, 'the focus was %s, but a later request switched it to %s' % (
            focus, status.focus))
    return SetFocusResponse(True, answer(focus, before, status.streams))
