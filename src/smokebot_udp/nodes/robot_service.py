# SPDX-License-Identifier: BSD-3-Clause
"""Runs the robot's side of a service stream: calls the robot's service for operators."""
import ast
import re
import threading
import time
from typing import Any, Mapping, Optional

import rospy

from ..monitoring.sources import SERVICE, Source
from ..monitoring.stats import StreamStats
from ..reliable.bounds import Bounds
from ..reliable.call_server import CallServer, Execution
from ..reliable.calls import MAX_CALLS, MAX_TIMEOUT, Outcome, type_checksum
from ..serialised import deserialised, serialised
from ..streams.message_types import service_class
from ..streams.relay.parameters import TO_OPERATOR, TO_ROBOT
from .channel import ChannelKind, ChannelListener
from .way import RobotWay, WayBackStream

CALLS = 'call'
"""Type of both channels of a service stream: services of another type are refused with a reason, by the call."""

BOUNDS = Bounds(messages=2 * MAX_CALLS, bytes=4 << 20, age=MAX_TIMEOUT, one_session=True)
"""Bounds of the messages that wait in a channel, for requests and for answers."""

RAISED = re.compile(r'service \[(?P<service>.*?)\] responded with an error: (?P<text>b.*)$', re.DOTALL)
"""rospy's words for what a service raised; the text is the repr() of bytes."""


def calls_channel(name: str, direction: str, bounds: Bounds = BOUNDS) -> ChannelKind:
    """One of a service stream's two channels."""
    return ChannelKind(name, direction, CALLS, '', ordered=False, expedited=True, bounds=bounds)


class RobotService(WayBackStream):
    """Executes calls, each in a thread of its own: one that hangs delays no other.

    After `close` it takes no more calls; those that are executed end without an answer.

    :param name: of the stream in streams.yaml
    :param settings: {name: value}, checked
    :param way: carries requests and answers
    """

    def __init__(self, name: str, settings: Mapping[str, Any], way: RobotWay) -> None:
        super().__init__(name, rospy.resolve_name(settings['robot_service']), settings)
        self._class = service_class(settings['service_type'])
        self.source = Source(SERVICE, self.topic)
        self._link = way.reliable
        self._server = CallServer(type_checksum(self._class._type, self._class._md5sum), self._class._type)
        self._lock = threading.Lock()
        self._answers: Any = None       # made by start()
        self._calls = self._answered = 0

    def start(self) -> None:
        """Begin to take calls."""
        self._answers = self._opened.add(self._link.channel(calls_channel(self.name, TO_OPERATOR)))
        self._opened.add(self._link.channel(
            calls_channel(self.name, TO_ROBOT), ChannelListener(received=self._received)))

    def stats(self) -> StreamStats:
        """What the stream did, for diagnostics."""
        with self._lock:
            overdue, dropped = self._server.overdue(time.monotonic()), dict(self._server.dropped)
        return StreamStats(
            self._calls, self._answered, steady=False, to_robot=True, dropped=dropped,
            connections=self._link.connections(sending=False),
            problem='%d calls of %s hang' % (overdue, self.topic) if overdue else None)

    def _received(self, peer: str, data: bytes) -> None:
        """Take a message of an operator, in the link's thread."""
        with self._lock:
            answer = self._server.receive(peer, data, time.monotonic())
        self._answer(peer, answer)
        self._begin()

    def _begin(self) -> None:
        """Begin the calls that wait, as far as there may be threads."""
        while True:
            with self._lock:
                execution = self._server.take(time.monotonic())
                if execution is None:
                    return
                self._calls += 1
            threading.Thread(target=self._execute, args=(execution,), name=self.topic, daemon=True).start()

    def _execute(self, execution: Execution) -> None:
        outcome = self._call(execution.request.data)
        with self._lock:
            answer = self._server.finish(execution, outcome, time.monotonic())
            self._answered += 1
        self._answer(execution.peer, answer)
        self._begin()

    def _answer(self, peer: str, answer: Optional[bytes]) -> None:
        if answer is not None:
            self._answers.send(answer, peer)

    def _call(self, data: bytes) -> Outcome:
        """Call the service. A proxy for each call finds the service's node also after its restart."""
        try:
            request = deserialised(self._class._request_class, data)
            return Outcome(serialised(rospy.ServiceProxy(self.topic, self._class)(request)))
        except Exception as error:      # also what the sockets raise
            return Outcome(failure=failure_of(str(error)))


def failure_of(text: str) -> str:
    """Why a call failed on the robot.

    :param text: of rospy's exception
    """
    raised = RAISED.match(text)
    if raised is None:
        return 'on the robot: %s' % text
    try:
        reason = ast.literal_eval(raised.group('text')).decode('utf-8', 'replace')
    except (ValueError, SyntaxError, AttributeError):
        reason = raised.group('text')
    return 'on the robot %s failed: %s' % (raised.group('service'), reason)
