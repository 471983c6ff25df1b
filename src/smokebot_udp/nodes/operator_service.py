# SPDX-License-Identifier: BSD-3-Clause
"""Runs the operator's side of a service stream: offers a service of the robot to the operator's nodes."""
import queue
import time
from typing import Any, Mapping, Optional

import rospy

from ..monitoring.stats import StreamStats
from ..reliable.call_client import CallClient, Message
from ..reliable.calls import Outcome, type_checksum
from ..serialised import deserialised, serialised
from ..streams.frame_prefix import add_prefix, strip_prefix
from ..streams.message_types import service_class
from ..streams.relay.parameters import TO_OPERATOR, TO_ROBOT
from .channel import ChannelListener
from .common import operator_topic
from .logging import log_error
from .robot_service import BOUNDS, calls_channel
from .way import OperatorWay, WayBackStream
from .worker import DeadlineWorker


class OperatorService(WayBackStream):
    """Sends the calls of a service to the robot; each ends with its answer, or a ServiceException that says why.

    :param name: of the stream in streams.yaml
    :param settings: {name: value}, checked
    :param way: carries requests and answers
    """

    def __init__(self, name: str, settings: Mapping[str, Any], way: OperatorWay) -> None:
        super().__init__(name, operator_topic(settings['operator_service']), settings)
        self._class = service_class(settings['service_type'])
        self._link = way.reliable
        self._prefix = way.frame_prefix
        self._end: Optional[str] = None     # why no call is sent any more
        self._client = CallClient(way.control.session << 32, type_checksum(self._class._type, self._class._md5sum),
                                  settings['timeout'])
        self._worker: DeadlineWorker[Message] = DeadlineWorker(
            name, self._client.poll, self._client.deadline, self._send, log_error("stream '%s'" % name))
        self._requests: Any = None      # made by start()
        self._calls = self._answered = 0

    def start(self) -> None:
        """Offer the service."""
        self._requests = self._opened.add(self._link.channel(
            calls_channel(self.name, TO_ROBOT, BOUNDS._replace(age=self._client.timeout)),
            ChannelListener(joined=self._joined, left=self._left, unknown=self._unknown)))
        self._opened.add(self._link.channel(
            calls_channel(self.name, TO_OPERATOR), ChannelListener(received=self._received)))
        self._opened.started(self._worker)
        self._opened.callback(self._fail)
        self._opened.callback(rospy.Service(self.topic, self._class, self._call).shutdown)

    def stats(self) -> StreamStats:
        """What the stream did, for diagnostics: responses that came, calls that were made."""
        return StreamStats(self._answered, self._calls, steady=False, to_robot=True,
                           dropped=dict(self._client.dropped), connections=self._link.connections(sending=True))

    def _fail(self) -> None:
        """The node ends, and with it the calls in flight."""
        with self._worker.changing():
            self._end = 'the node of the service has ended'
            self._client.fail(self._end)

    def _call(self, request: Any) -> Any:
        """Call the robot's service, in a thread of rospy.

        :raises rospy.ServiceException: where there is no answer
        """
        data = serialised(strip_prefix(request, self._prefix))
        ended: queue.Queue[Outcome] = queue.Queue()
        with self._worker.changing():
            if self._end is not None:
                raise rospy.ServiceException(self._end)
            self._calls += 1
            self._client.call(data, time.monotonic(), ended.put)
        outcome = ended.get()
        if outcome.failure is not None:
            raise rospy.ServiceException(outcome.failure)
        with self._worker.changing():
            self._answered += 1
        return self._response(outcome.data)

    def _response(self, data: bytes) -> Any:
        try:
            return add_prefix(deserialised(self._class._response_class, data), self._prefix)
        except ValueError as error:
            raise rospy.ServiceException(str(error)) from None

    def _send(self, message: Message) -> None:
        self._requests.send(message.data, message.robot)

    def _received(self, peer: str, data: bytes) -> None:
        with self._worker.changing():
            self._client.receive(peer, data, time.monotonic())

    def _joined(self, peer: str) -> None:
        with self._worker.changing():
            self._client.joined(peer)

    def _left(self, peer: str, reason: str) -> None:
        with self._worker.changing():
            self._client.left(peer, "the robot's node %s during the call" % (
                'restarted' if reason == 'restart' else 'was away'))

    def _unknown(self, peer: str) -> None:
        with self._worker.changing():
            self._client.refuse("the robot has no stream '%s' of type service" % self.name)
