# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of a command stream: publishes operators' commands while they are new, and what follows them.

teleop/command_gate.py decides which commands take effect, teleop/timeout.py when on_timeout is published. Commands are
published in the transport's thread, at once; on_timeout in a thread of the stream. Both hold its lock, so that after a
stop no command is published that was taken before.
"""
import collections
import time
from typing import Any, Counter, Deque, Mapping, Optional

import rospy

from ..limited_log import logerr
from ..mission.parameters import live
from ..mission.settings import Settings
from ..monitoring.sources import LISTENER, Source
from ..monitoring.stats import ConnectionStats, Shown, StreamStats
from ..msg import Command
from ..serialised import deserialised
from ..streams.command.parameters import ROBOT, timeout_message
from ..streams.message_types import message_class
from ..streams.relay.parts import carried
from ..streams.segments import wire_topic
from ..teleop.command_copy import Copy
from ..teleop.command_gate import CommandGate
from ..teleop.stall import Suspension
from ..teleop.timeout import CommandTimeout, State
from ..transport import Subscriber
from ..udpros.records import has_header
from .logging import log_error
from .way import RobotWay, WayBackStream
from .worker import DeadlineWorker

COMMANDS = 'commands'
"""Last part of the wire topic."""

MAX_SHOWN = 512
"""Ages of this number of commands are kept until `stats` is called."""

FLUSH_TIME = 0.1
"""When the node ends, rospy has this long to send the stop: it does so in threads of its own [s]."""

PROBLEMS = {State.STOPPING: 'no command came in time: it stops', State.ESTOP: 'emergency stop'}


class RobotCommand(WayBackStream):
    """One command stream.

    :param name: of the stream in streams.yaml
    :param settings: {name: value}, checked
    :raises ValueError: where the settings are impossible
    """

    def __init__(self, name: str, settings: Mapping[str, Any], way: RobotWay) -> None:
        super().__init__(name, rospy.resolve_name(settings['robot_topic']), settings, live(ROBOT))
        self._way, self._wire_topic = way, wire_topic(name, COMMANDS)
        self._class = message_class(settings['message_type'])
        self.source = Source(LISTENER, self.topic, self._class._type)
        self._on_timeout = timeout_message(settings)
        self._gate = CommandGate(way.control.session, self._class._md5sum, settings['max_age'])
        self._timeout = CommandTimeout(settings['timeout'], settings['rate'], settings['hold'])
        self._dropped: Counter[str] = collections.Counter()
        self._received = self._published = 0
        self._ruled = 0, 0      # session of who drives, releases of the emergency stop
        self._suspension = Suspension()
        self._ages: Deque[Shown] = collections.deque(maxlen=MAX_SHOWN)
        self._publisher: Any = None     # made by start(), as is this
        self._subscriber: Optional[Subscriber] = None
        self._worker: DeadlineWorker[bool] = DeadlineWorker(
            name, self._poll, self._timeout.deadline, lambda _: None, log_error("stream '%s'" % name))

    def start(self) -> None:
        """Begin to accept commands."""
        self._publisher = self._opened.topic(
            rospy.Publisher(self.topic, self._class, queue_size=1, tcp_nodelay=True))
        self._worker.start()
        self._opened.callback(self._end)
        self._way.control.subscribe(self._follow)
        self._follow()
        self._look_for_suspension()
        self.settings.subscribe(self._configure)
        self._subscriber = self._opened.topic(self._way.transport.subscriber(
            self._wire_topic, Command, self._take, carries=carried(self._class)))

    def _end(self) -> None:
        """End the thread; a robot that is driven is stopped."""
        with self._worker.changing():
            self._gate.rule(0, False, 0, time.monotonic())     # nor is taken what another thread is about to take
            driven = self._timeout.state is State.DRIVING
            self._timeout.interrupt(time.monotonic())
            self._poll(time.monotonic())
        self._worker.close()
        if driven:
            time.sleep(FLUSH_TIME)

    @property
    def heard(self) -> bool:
        """See WayBackStream."""
        return self._publisher is not None and bool(self._publisher.get_num_connections())

    def stats(self) -> StreamStats:
        """What the stream does and did, for diagnostics; ages since the last call."""
        found = [] if self._subscriber is None else self._subscriber.connections()
        with self._worker.changing():
            state, timeouts = self._timeout.state, self._timeout.timeouts
            dropped = self._dropped + self._gate.dropped
        return StreamStats(
            self._received, self._published, self.settings.current['enabled'], steady=False, dropped=dict(dropped),
            shown=[self._ages.popleft() for _ in range(len(self._ages))],
            connections=[ConnectionStats(**one) for one in found], to_robot=True,
            activity='%s, timeouts: %d' % (state.value, timeouts), problem=PROBLEMS.get(state))

    def _configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        """Settings changed, see SettingsStore.subscribe."""
        with self._worker.changing():
            self._gate.max_age = settings['max_age']
            self._timeout.timeout, self._timeout.rate = settings['timeout'], settings['rate']
            self._timeout.hold = settings['hold']
            if not settings['enabled']:
                self._timeout.interrupt(time.monotonic())

    def _follow(self) -> None:
        """Who drives may have changed, or the emergency stop; any thread."""
        with self._worker.changing():
            now, standing = time.monotonic(), self._way.control.standing
            self._gate.rule(standing.session, standing.estop, standing.releases, now)
            if (standing.session, standing.releases) != self._ruled:    # also after a stop that was ended at once
                self._ruled = standing.session, standing.releases
                self._timeout.interrupt(now)
            self._timeout.set_estop(standing.estop, now)
            self._poll(now)     # a stop is published at once, before a command of the new driver

    def _take(self, message: Any) -> None:
        """Take a copy of a command; the transport's thread."""
        operator = message._connection_header['callerid']
        refusal = self._way.control.command(operator, message.session, self._wire_topic, message.header.seq)
        with self._worker.adding():
            self._received += 1
            if not self.settings.current['enabled']:
                refusal = 'off'
            if refusal is not None:
                self._dropped[refusal] += 1
                return
            differ = self._gate.dropped['type']
            self._look_for_suspension()
            self._accept(Copy.of(message), time.monotonic())
            differ = self._gate.dropped['type'] - differ
        if differ:
            logerr("stream '%s'" % self.name, 'the commands of %s are not carried out: they are no %s as it is '
                   'installed here' % (operator, self._class._type), 10.0)

    def _look_for_suspension(self) -> None:
        """Stop after the machine was suspended; the lock is held, or nothing is taken yet."""
        if self._suspension.notice(time.monotonic(), time.clock_gettime(time.CLOCK_BOOTTIME), time.monotonic()):
            self._gate.void(time.monotonic())
            self._timeout.interrupt(time.monotonic())

    def _accept(self, copy: Copy, now: float) -> None:
        """Publish a command if it takes effect; the lock is held."""
        accepted = self._gate.take(copy, now)
        if accepted is None:
            return
        try:
            command = deserialised(self._class, accepted.data)
        except ValueError:
            self._dropped['message'] += 1
            return
        self._timeout.accepted(now, accepted.age)
        self._ages.append(Shown(accepted.age, None))
        self._publish(command)

    def _poll(self, now: float) -> Optional[bool]:
        """Publish on_timeout if it is due; under the lock."""
        if self._timeout.poll(now) and self._on_timeout is not None:
            if has_header(self._class):
                self._on_timeout.header.stamp = rospy.Time.now()
            self._publish(self._on_timeout)
        return None

    def _publish(self, message: Any) -> None:
        self._publisher.publish(message)
        self._published += 1
