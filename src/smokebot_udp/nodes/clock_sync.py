# SPDX-License-Identifier: BSD-3-Clause
"""How far the robot's clock is from the operator's: asked over the link once a second, see supervisor.clock.

What is compared is the time that stamps are made of, so rospy's: the machine's clock, or a simulation's.
"""
import collections
import threading
import time
from typing import NamedTuple

import rospy

from .. import udpros
from ..monitoring.clock_offset import ClockOffset
from ..msg import ClockEcho
from ..streams.rate import Repeater

ASK = 'smokebot_udp/clock/ask'
ANSWER = 'smokebot_udp/clock/answer'
"""Where questions and answers cross."""

PERIOD = 1.0
"""[s]"""

OPEN = 16
"""Questions that an answer may still come to: over a link that keeps it for longer it says nothing."""


class ClockServer:
    """The robot's side: answers, to all who listen; each finds its own."""

    def __init__(self):
        self._answers = udpros.Publisher(ANSWER, ClockEcho, queue_size=1)
        self._questions = udpros.Subscriber(ASK, ClockEcho, self._answer, queue_size=1)

    def _answer(self, question):
        answer = ClockEcho(asked=question.asked, received=rospy.Time.now())
        answer.header.stamp = rospy.Time.now()
        self._answers.publish(answer)

    def close(self):
        self._questions.unregister()
        self._answers.unregister()


class Estimate(NamedTuple):
    """What is known of the robot's clock; all in [s]."""
    offset: float
    """The robot's clock minus this machine's."""
    round_trip: float
    uncertainty: float
    """The offset is wrong by at most this."""


class ClockClient:
    """The operator's side: asks."""

    def __init__(self):
        self._clock, self._lock = ClockOffset(), threading.Lock()
        self._open = collections.deque(maxlen=OPEN)     # when they were asked [ns]
        self._answers = udpros.Subscriber(ANSWER, ClockEcho, self._answered, queue_size=1)
        self._questions = udpros.Publisher(ASK, ClockEcho, queue_size=1)
        self._ask = Repeater('clock', self._ask_once, self._report, PERIOD)
        self._ask.start()

    @property
    def estimate(self):
        """An Estimate; None where the robot did not answer lately."""
        now = time.monotonic()
        with self._lock:
            if not self._clock.valid(now):
                return None
            return Estimate(self._clock.offset, self._clock.round_trip, self._clock.uncertainty(now))

    def offset(self):
        """How far the robot's clock is ahead [s]; where it is not known both are taken to agree."""
        estimate = self.estimate
        return estimate.offset if estimate else 0.0

    @property
    def counts(self):
        """{what: how often}: jumps of a clock, and answers refused by reason; unasked may be other operators'."""
        with self._lock:
            return {'jumps': self._clock.jumps,
                    **{'refused, ' + reason: count for reason, count in self._clock.refused.items()}}

    def _ask_once(self):
        now = rospy.Time.now()
        with self._lock:
            self._open.append(now.to_nsec())
        question = ClockEcho(asked=now)
        question.header.stamp = now
        self._questions.publish(question)

    def _answered(self, answer):
        came, now = rospy.Time.now(), time.monotonic()
        with self._lock:
            # each question counts once: what is sent twice, or made up, is nobody's answer
            if answer.asked.to_nsec() not in self._open:
                self._clock.refused['unasked'] += 1
                return
            self._open.remove(answer.asked.to_nsec())
            self._clock.add(answer.asked.to_sec(), answer.received.to_sec(), answer.header.stamp.to_sec(),
                            came.to_sec(), now)

    def _report(self, error):
        if not rospy.is_shutdown():
            rospy.logerr_throttle_identical(60, "the robot's clock cannot be asked for: %s" % error)

    def close(self):
        self._ask.stop()
        self._answers.unregister()
        self._questions.unregister()
