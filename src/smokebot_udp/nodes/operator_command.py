# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of a command stream: sends each message of a topic several times, while it is the newest.

teleop/command_sender.py decides when which copy is sent, teleop/interlock.py whether the operator may command at all.
"""
import collections
import math
import time
from typing import Any, Counter, Mapping, Optional, Tuple

import rospy

from ..limited_log import ERROR_PERIOD, logerr, logwarn
from ..mission.parameters import live
from ..mission.settings import Settings
from ..monitoring.sources import TOPIC, Source
from ..monitoring.stats import ConnectionStats, StreamStats
from ..msg import Command
from ..serialised import serialised
from ..streams.command.parameters import OPERATOR, timeout_message
from ..streams.message_types import message_class
from ..streams.relay.parts import carried
from ..streams.segments import wire_topic
from ..teleop.command_copy import Copy
from ..teleop.command_sender import CommandSender
from ..teleop.interlock import START_FROM_NEUTRAL, Interlock
from ..teleop.neutral import Neutral
from ..traffic import EXPEDITED
from ..transport import Publisher
from .common import operator_topic
from .robot_command import COMMANDS
from .way import OperatorWay, WayBackStream
from .worker import DeadlineWorker

NEW = 1.0
"""A message that came longer ago does not say where the sticks are [s]."""

HINT = '. Where the sticks are at rest, call ~set_neutral, or set on_timeout of the stream to what they show'


class OperatorCommand(WayBackStream):
    """One command stream.

    :param name: of the stream in streams.yaml
    :param settings: {name: value}, checked
    :raises ValueError: where the settings are impossible
    """

    def __init__(self, name: str, settings: Mapping[str, Any], way: OperatorWay) -> None:
        super().__init__(name, operator_topic(settings['operator_topic']), settings, live(OPERATOR))
        self._way = way
        self._class = message_class(settings['message_type'])
        self.source = Source(TOPIC, self.topic, self._class._type)
        self._sender = CommandSender(way.control.session, self._class._md5sum, settings['max_age'])
        self._view = settings['require_fresh']
        on_timeout = timeout_message(settings)
        self._neutral = Neutral(on_timeout)
        self._newest: Tuple[Any, float] = None, -math.inf       # message, when it came
        self._interlock = Interlock(self._view, settings['max_view_age'], on_timeout is not None)
        self._dropped: Counter[str] = collections.Counter()
        self._received = self._sent = 0
        self._problem: Optional[str] = None
        self._warned = False
        self._publisher: Optional[Publisher] = None     # made by start()
        self._worker: DeadlineWorker[Copy] = DeadlineWorker(name, self._poll, self._sender.deadline, self._send,
                                                            self._report)
        self.settings.subscribe(self._configure)

    def start(self) -> None:
        """Begin to send."""
        self._publisher = self._opened.topic(self._way.transport.publisher(
            wire_topic(self.name, COMMANDS), Command, queue_size=1, carries=carried(self._class), tos=EXPEDITED,
            copied=True))
        self._opened.started(self._worker)
        self._way.control.add_commands(self)
        self._opened.topic(rospy.Subscriber(self.topic, self._class, self._receive, queue_size=1, tcp_nodelay=True))

    def stats(self) -> StreamStats:
        """What the stream does and did, for diagnostics."""
        found = [] if self._publisher is None else self._publisher.connections()
        with self._worker.lock:
            dropped = dict(self._dropped)
        return StreamStats(self._received, self._sent, steady=False, dropped=dropped,
                           connections=[ConnectionStats(**one) for one in found], to_robot=True, problem=self._problem)

    def _configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        """Settings changed, see SettingsStore.subscribe."""
        with self._worker.changing():
            self._interlock.max_view_age = settings['max_view_age']

    def _view_age(self, now: float) -> Optional[float]:
        return self._way.view_age(self._view, now) if self._view else None

    def lock(self, now: float) -> Optional[str]:
        """See operator_control.Commands."""
        outlook, age = self._way.control.outlook(now), self._view_age(now)
        with self._worker.adding():
            reason = self._follow(self._interlock.look(age, self._sender.accepts(outlook.time), outlook.refusal,
                                                       outlook.releases))
            silent = now - self._newest[1] >= NEW
        return None if silent and reason is not None and reason.startswith(START_FROM_NEUTRAL) else reason

    @property
    def awaits_neutral(self) -> bool:
        """See operator_control.Commands."""
        return self._interlock.awaits_neutral

    def rest(self, now: float) -> Optional[str]:
        """See operator_control.Commands."""
        with self._worker.lock:
            message, came = self._newest
            return self._neutral.rests(message) if now - came < NEW and self._interlock.awaits_neutral else None

    def _follow(self, reason: Optional[str]) -> Optional[str]:
        """Note why no command leaves, and send no copies of the last one then; the lock is held."""
        self._problem = None if reason is None else 'locked: ' + reason
        if reason is not None:
            self._sender.withdraw()
        return reason

    def _receive(self, message: Any) -> None:
        """Take a command; rospy's thread."""
        if message._type != self._class._type:   # where this node subscribes the topic with another type as well
            self._report(ValueError('it is %s, must be %s' % (message._type, self._class._type)))
            return
        now = time.monotonic()
        outlook, age = self._way.control.outlook(now), self._view_age(now)
        data = serialised(message)
        with self._worker.changing():
            self._received += 1
            self._way.control.commanded = True
            self._newest = message, now
            reason = self._follow(self._interlock.may_send(
                self._neutral.deviation(message), age, self._sender.accepts(outlook.time), outlook.refusal,
                outlook.releases))
            problem = None
            if reason is not None:
                self._dropped['locked'] += 1
            else:
                problem = self._put(data, outlook, now)
        if problem is not None:
            self._report(problem)
        self._warn(reason)

    def _put(self, data: bytes, outlook: Any, now: float) -> Optional[ValueError]:
        """Send a command; the lock is held. Returns why it is not sent."""
        try:
            self._sender.put(data, outlook.time, outlook.releases, now)
        except ValueError as error:
            self._dropped['too long'] += 1
            return error
        return None

    def _warn(self, reason: Optional[str]) -> None:
        """Say once that commands are not sent, until one is sent."""
        if reason is None:
            self._warned = False
        elif not self._warned:
            self._warned = logwarn("stream '%s'" % self.name, 'commands are not sent: %s%s' % (
                reason, HINT if reason.startswith(START_FROM_NEUTRAL) else ''), ERROR_PERIOD)

    def _poll(self, now: float) -> Optional[Copy]:
        self._sender.loss = self._way.control.loss
        return self._sender.poll(now)

    def _send(self, copy: Copy) -> None:
        """Send a copy, in the worker's thread."""
        if self._publisher is not None and not rospy.is_shutdown():
            self._publisher.publish(Command(**copy._asdict()))
            self._sent += 1

    def _report(self, error: Exception) -> None:
        logerr("stream '%s'" % self.name, 'a message of %s is not sent: %s' % (self.topic, error))
