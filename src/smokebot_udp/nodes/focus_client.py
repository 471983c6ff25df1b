# SPDX-License-Identifier: BSD-3-Clause
"""The operator's switch of the robot's focus over the same lossy link: asked until the robot's status answers."""
import random
import threading
import time

import rospy

from .. import udpros
from ..msg import FocusRequest, RobotStatus
from ..srv import SetFocus, SetFocusResponse
from .focus import REQUESTS

ASKED_AGAIN = 0.1
"""[s]"""


class FocusClient:
    """Serves ~set_focus on the operator's side.

    :param status_topic: where the robot's RobotStatus comes out, or None where no stream brings it
    :param patience: how long to ask [s]
    """

    def __init__(self, status_topic, patience):
        self._status, self._patience = None, patience
        self._answered = threading.Condition()
        self._one_at_a_time = threading.Lock()
        self._requests = udpros.Publisher(REQUESTS, FocusRequest, queue_size=1)
        self._subscriber = status_topic and rospy.Subscriber(status_topic, RobotStatus, self._take, queue_size=5)
        rospy.Service('~set_focus', SetFocus, self._serve)

    def _take(self, status):
        with self._answered:
            self._status = status
            self._answered.notify_all()

    def sent(self):
        """{stream: StreamStatus}: what the robot said last that it sends."""
        with self._answered:
            status = self._status
        return {stream.name: stream for stream in status.streams} if status else {}

    def _serve(self, asked):
        if self._subscriber is None:
            return SetFocusResponse(False, 'no answer can come: streams.yaml has no relay of smokebot_udp/RobotStatus')
        with self._one_at_a_time:
            request = FocusRequest(id=random.randint(1, 2 ** 32 - 1), focus=asked.focus)
            deadline = time.monotonic() + self._patience
            with self._answered:
                while self._status is None or self._status.request != request.id:
                    if time.monotonic() > deadline or rospy.is_shutdown():
                        return SetFocusResponse(False, 'the robot did not answer in %g s' % self._patience)
                    self._requests.publish(request)
                    self._answered.wait(ASKED_AGAIN)
                refusal = self._status.refusal
        return SetFocusResponse(not refusal, refusal or 'the focus is ' + asked.focus)

    def close(self):
        self._requests.unregister()
        if self._subscriber is not None:
            self._subscriber.unregister()
