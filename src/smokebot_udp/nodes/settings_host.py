# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of the settings across the link: carries out what operators request, and sends what is in effect.

Operators with masters of their own cannot reach the robot's parameters. mission/settings_server.py decides.
"""
import random
import threading
import time
from typing import Any, Callable, Mapping

import rospy

from ..limited_log import logerr
from ..mission.control import MissionControl
from ..mission.remote import FOCUS_PART, PartState
from ..mission.settings_server import SettingsServer
from ..msg import SettingsRequest, SettingsState
from ..traffic import SENSORS
from .logging import log_error
from .opened import Part
from .robot_stream import RobotLink
from .settings_messages import REQUESTS, STATES, request_of, state_message
from .worker import DeadlineWorker


class SettingsHost(Part, rospy.SubscribeListener):
    """Lives as long as its node.

    :param control: all requests for settings go through it
    :param carry_out: f(part, changes) -> what has changed, in words; raises ValueError where it is refused
    :param link: to the operators; with a shared master only the focus crosses it
    :param report: f(problem), called with what is refused
    """

    def __init__(self, control: MissionControl, carry_out: Callable[[str, Mapping[str, Any]], str], link: RobotLink,
                 report: Callable[[str], None]) -> None:
        super().__init__()
        self._control, self._carry_out, self._outbox, self._report = control, carry_out, link.outbox, report
        self._all = link.transport.own_masters
        self._server = SettingsServer(random.randint(1, 2 ** 32 - 1), control.profiles)
        self._updating = threading.Lock()   # otherwise an older state might replace a newer one; the outermost lock
        self._worker: DeadlineWorker[PartState] = DeadlineWorker(
            'settings across the link', self._server.poll, self._server.deadline, self._send,
            log_error('settings across the link'))
        self.update()
        self._states = self._opened.topic(
            link.transport.publisher(STATES, SettingsState, subscriber_listener=self, tos=SENSORS))
        self._opened.started(self._worker)
        self._opened.topic(link.transport.subscriber(REQUESTS, SettingsRequest, self._receive))

    def update(self) -> None:
        """Settings may have changed; any thread that holds no lock of theirs."""
        with self._updating:
            parts = self._control.parts()
            if not self._all:
                parts = {FOCUS_PART: parts[FOCUS_PART]}
            with self._worker.changing():
                self._server.update(parts)

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """There is a new operator."""
        self.joined()

    def joined(self) -> None:
        """An operator may lack what was sent before; any thread."""
        with self._worker.changing():
            self._server.joined()

    def _receive(self, message: Any) -> None:
        """Serve a request; the transport's thread."""
        operator = message._connection_header['callerid']
        try:
            request = request_of(message)
        except ValueError as error:
            logerr('a request for settings of %s is not served' % operator, error)
            return
        with self._worker.changing():
            wanted = self._server.take(request, time.monotonic())
        if not wanted:
            return
        refusal = changes = ''
        try:
            changes = self._carry_out(request.part, request.values)
        except ValueError as error:
            refusal = str(error)
            self._report('%s requests %s: refused: %s' % (operator, request.part or 'a focus', error))
        self.update()
        with self._worker.changing():
            self._server.answer(request, refusal, changes)

    def _send(self, state: PartState) -> None:
        self._outbox.publish_message(self._states, state_message(state))
