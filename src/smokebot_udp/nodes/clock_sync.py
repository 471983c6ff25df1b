# SPDX-License-Identifier: BSD-3-Clause
"""The offset of the robot's clock from the operator's, measured over the link (monitoring.clock_offset).

The clocks compared are rospy's, from which stamps come: the machine's clock, or a simulation's.
"""
import math
import threading
import time
from typing import Any, Dict, Optional

import rospy
from std_msgs.msg import Float64

from ..monitoring.clock_client import PERIOD, EchoClient
from ..monitoring.clock_offset import ClockEstimate
from ..msg import ClockEcho
from ..traffic import EXPEDITED
from ..transport import Transport
from .logging import log_error
from .opened import Part
from .worker import PeriodicWorker

ASK = '/smokebot_udp/clock/ask'
ANSWER = '/smokebot_udp/clock/answer'
"""Wire topics of questions and answers."""


class ClockServer(Part):
    """The robot's side: publishes answers; each operator picks its own."""

    def __init__(self, transport: Transport) -> None:
        super().__init__()
        self._answers = self._opened.topic(transport.publisher(ANSWER, ClockEcho, queue_size=1, tos=EXPEDITED))
        self._opened.topic(transport.subscriber(ASK, ClockEcho, self._answer, queue_size=1))

    def _answer(self, question: Any) -> None:
        answer = ClockEcho(asked=question.asked, received=rospy.Time.now())
        answer.header.stamp = rospy.Time.now()
        self._answers.publish(answer)


class ClockClient(Part):
    """The operator's side: asks, and estimates the offset from the answers. ~clock_offset shows it [s]."""

    def __init__(self, transport: Transport) -> None:
        super().__init__()
        self._echoes, self._lock = EchoClient(), threading.Lock()
        self._offsets = self._opened.topic(rospy.Publisher('~clock_offset', Float64, queue_size=1))
        self._questions = self._opened.topic(transport.publisher(ASK, ClockEcho, queue_size=1, tos=EXPEDITED))
        self._opened.topic(transport.subscriber(ANSWER, ClockEcho, self._answered, queue_size=1))
        self._opened.started(PeriodicWorker('clock', self._ask, log_error("asking for the robot's clock"), PERIOD))

    @property
    def estimate(self) -> Optional[ClockEstimate]:
        """The estimate of the robot's clock; None without a recent answer."""
        with self._lock:
            return self._echoes.estimate(time.monotonic())

    def offset(self) -> float:
        """The robot's clock minus this machine's [s]; 0 if it was not measured, NaN if the answers contradict it."""
        with self._lock:
            estimate, refuted = self._echoes.estimate(time.monotonic()), self._echoes.refuted
        return estimate.offset if estimate else math.nan if refuted else 0.0

    @property
    def counts(self) -> Dict[str, int]:
        """{event: how often}, see EchoClient."""
        with self._lock:
            return self._echoes.counts

    def _ask(self) -> None:
        with self._lock:
            due = self._echoes.due(time.monotonic())
        if due:
            now = rospy.Time.now()
            with self._lock:
                self._echoes.ask(now.to_nsec(), time.monotonic())
            question = ClockEcho(asked=now)
            question.header.stamp = now
            self._questions.publish(question)
        estimate = self.estimate
        if estimate is not None:
            self._offsets.publish(estimate.offset)

    def _answered(self, answer: Any) -> None:
        came, now = rospy.Time.now(), time.monotonic()
        with self._lock:
            self._echoes.answer(answer.asked.to_nsec(), answer.received.to_sec(), answer.header.stamp.to_sec(),
                                came.to_sec(), now)
