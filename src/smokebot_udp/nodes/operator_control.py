# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of control: asks the robot for control and for the emergency stop, and follows its clock.

teleop/control_client.py decides. Services: ~take_control, ~release_control, ~estop (true: engage, false: release),
~set_neutral. Topics: operator/estop (Bool) engages it, and never releases it, operator/estop_release (Empty) releases
it. operator/control (latched) shows the state in words, as the views do.
"""
import math
import random
import threading
import time
from typing import Any, List, Mapping, NamedTuple, Optional, Protocol, Sequence, Tuple

import rospy
from std_msgs.msg import Bool, Empty, String
from std_srvs.srv import SetBool, SetBoolResponse, Trigger, TriggerResponse

from ..codecs.display.overlay import EMERGENCY_STOP
from ..limited_log import logerr
from ..monitoring.node_status import operator_control_status
from ..monitoring.status import Status
from ..msg import ControlRequest, ControlStatus
from ..teleop import records
from ..teleop.command_copy import MICROSECONDS
from ..teleop.control_client import ControlClient
from ..teleop.estop import EstopInput
from ..teleop.interlock import START_FROM_NEUTRAL
from ..teleop.records import Wish
from ..teleop.robot_clock import RobotClock, RobotTime
from ..teleop.stall import Stall
from ..traffic import EXPEDITED
from ..transport import Transport
from .common import operator_topic
from .logging import log_error
from .notice import Notice
from .opened import Part
from .robot_control import REQUEST, STATUS
from .worker import DeadlineWorker, PeriodicWorker

ANSWER_TIMEOUT = 3.0
"""How long a service waits for the robot's answer [s]."""

CLOCK_PERIOD = 0.05
"""How often the robot's clock is asked for while it is unknown [s]."""

SHOW_PERIOD = 0.1
"""How often the state is looked at: an image grows old without an event [s]."""

ESTOP_TOPIC, RELEASE_TOPIC, STATE_TOPIC = '/operator/estop', '/operator/estop_release', '/operator/control'
"""Topics of the operator's side, in the node's namespace."""

IN_CONTROL = 'in control'
"""The state where commands leave; the beginning of both that say so."""

FROM_REST = IN_CONTROL + ': start at rest'
"""The state where a neutral command has to come first: after an emergency stop, or a lock."""

DONE = {Wish.TAKE_CONTROL: 'this operator drives', Wish.RELEASE_CONTROL: 'nobody drives',
        Wish.ENGAGE_ESTOP: 'the emergency stop is engaged', Wish.RELEASE_ESTOP: 'the emergency stop is released'}
"""{what was asked for: the answer of a service where the robot has done it}"""

LOCKED = 'LOCKED: '
NO_COMMANDS = 'no command stream'


class Outlook(NamedTuple):
    """What the robot makes of commands, as this operator knows it."""
    refusal: str
    """Why it does not take them; empty: it does."""
    time: Optional[RobotTime]
    """Its steady clock; None: unknown."""
    releases: Optional[int]
    """How often the emergency stop was released; None: unknown."""


class Commands(Protocol):
    """A command stream, as control sees it. Times are by time.monotonic() [s]."""
    name: str

    def lock(self, now: float) -> Optional[str]:
        """Why it would not send now; None: it would. A neutral command is asked for only where commands come."""

    @property
    def awaits_neutral(self) -> bool:
        """Whether nothing leaves before a neutral command."""

    def rest(self, now: float) -> Optional[str]:
        """The sticks are at rest: what they show, which is neutral from now on; None: it does not wait for that."""


class OperatorControl(Part):
    """Lives as long as its node. Any thread may use it.

    :param notice: that the views show
    """

    def __init__(self, transport: Transport, notice: Notice) -> None:
        super().__init__()
        self.session = random.randint(1, 2 ** 32 - 1)
        """Session of this node: a random number other than 0."""
        self._client, self._clock, self._input = ControlClient(self.session), RobotClock(), EstopInput()
        self._notice, self._stall = notice, Stall()
        self.commanded = False
        """Whether a command came at this desk: until then images show no lock. Command streams set it."""
        self._commands: List[Commands] = []     # replaced, not changed
        self._answered = threading.Condition()
        self._state = ''
        log = log_error('control of the robot')
        self._asked = -math.inf     # when the last request was sent [s]
        self._worker: DeadlineWorker[records.Request] = DeadlineWorker('control', self._poll, self._deadline,
                                                                       self._send, log)
        opened = self._opened
        self._states = opened.topic(rospy.Publisher(operator_topic(STATE_TOPIC), String, queue_size=1, latch=True))
        self._show = PeriodicWorker('control state', self._show_state, log, SHOW_PERIOD)
        self._requests = opened.topic(transport.publisher(REQUEST, ControlRequest, queue_size=5, tos=EXPEDITED,
                                                           copied=True))
        opened.started(self._worker)
        opened.started(self._show)
        rospy.Service('~take_control', Trigger, lambda _: TriggerResponse(*self._ask(Wish.TAKE_CONTROL)))
        rospy.Service('~release_control', Trigger, lambda _: TriggerResponse(*self._ask(Wish.RELEASE_CONTROL)))
        rospy.Service('~estop', SetBool, self._serve_estop)
        rospy.Service('~set_neutral', Trigger, lambda _: TriggerResponse(*self._set_neutral()))
        opened.topic(transport.subscriber(STATUS, ControlStatus, self._receive))
        self._release = opened.topic(rospy.Subscriber(operator_topic(RELEASE_TOPIC), Empty, self._released,
                                                      queue_size=1, tcp_nodelay=True))
        opened.topic(rospy.Subscriber(operator_topic(ESTOP_TOPIC), Bool, self._pressed, queue_size=10,
                                      tcp_nodelay=True))

    def alive(self, when: float) -> None:
        """A datagram of the robot's streams came; any thread.

        :param when: by time.monotonic() [s]
        """
        self._client.alive = when

    @property
    def loss(self) -> Optional[float]:
        """Ratio of this node's datagrams that do not reach the robot, 0..1; None: unknown."""
        return self._client.loss

    @property
    def state(self) -> str:
        """In words, as on operator/control; empty: not known yet."""
        return self._state

    def situation(self) -> Tuple[bool, str, bool]:
        """Whether the emergency stop is engaged, who drives (empty: nobody), and whether that is this operator, as far
        as it is known."""
        with self._worker.lock:
            status = self._client.status
            return (self._client.estop, status.driver if status else '',
                    status is not None and status.driver_session == self.session)

    def robot_time(self, now: float) -> Optional[RobotTime]:
        """The robot's steady clock; None: unknown.

        :param now: by time.monotonic() [s]
        """
        with self._worker.lock:
            return self._clock.robot_time(now)

    def outlook(self, now: float) -> Outlook:
        """Whether this operator may send commands now.

        To be called for each command, by the time at which it came, and ten times a second besides.
        """
        with self._worker.lock:
            status = self._client.status
            return Outlook(self._stall.look(now) or self._client.refusal(now), self._clock.robot_time(now),
                           status.releases if status else None)

    def add_commands(self, commands: Commands) -> None:
        """Show the state of a command stream, too, and have ~set_neutral serve it."""
        self._commands = [*self._commands, commands]

    def status(self, now: float) -> Status:
        """For diagnostics."""
        known = self.robot_time(now)
        return operator_control_status(self._state, bool(self._notice.text),
                                       None if known is None else known.uncertainty / MICROSECONDS, self.loss)

    def _poll(self, now: float) -> Optional[records.Request]:
        """The request to be sent now; while the robot's clock is unknown there are more of them."""
        request = self._client.poll(now)
        if request is None and now >= self._deadline():
            request = records.Request(self.session, now, self._client.robot)
        if request is not None:
            self._asked = now
        return request

    def _deadline(self) -> float:
        unknown = self._clock.robot_time(time.monotonic()) is None
        return min(self._client.deadline(), self._asked + CLOCK_PERIOD if unknown else math.inf)

    def _send(self, request: records.Request) -> None:
        message = ControlRequest(**request.fields())
        with self._worker.changing():
            message.clock = self._clock.ask(time.monotonic())
        self._requests.publish(message)

    def _receive(self, message: Any) -> None:
        """Take a status of the robot; the transport's thread."""
        try:
            status = records.Status.of(message)
        except ValueError as error:
            logerr('a status of the robot is not used', error)
            return
        with self._worker.changing():
            now = time.monotonic()
            if not self._client.receive(status, now):
                return
            for own in (peer for peer in message.operators if peer.session == self.session):
                self._clock.update(message.session, own.echo, own.held, message.clock, now)
        with self._answered:
            self._answered.notify_all()
        self._show.wake()

    # -- services and topics: rospy's threads ---------------------------------------------------------

    def _serve_estop(self, asked: Any) -> Any:
        """Serve SetBool."""
        return SetBoolResponse(*self._ask(Wish.ENGAGE_ESTOP if asked.data else Wish.RELEASE_ESTOP))

    def _set_neutral(self) -> Tuple[bool, str]:
        """The sticks are at rest: (whether any stream waited for that, in words)."""
        now = time.monotonic()
        found = {one.name: one.rest(now) for one in self._commands}
        shown = ['%s: %s' % item for item in found.items() if item[1] is not None]
        return bool(shown), '; '.join(shown) or 'no command stream gets commands and waits for neutral ones'

    def _pressed(self, message: Any) -> None:
        """A message on the topic."""
        with self._worker.lock:
            press = self._input.is_press(message._connection_header['callerid'], bool(message.data), time.monotonic())
        if press:
            self._begin(Wish.ENGAGE_ESTOP)

    def _released(self, message: Any) -> None:
        """A message on the topic that releases the stop."""
        if message._connection_header.get('latching') == '1':   # it comes again when this node is restarted
            logerr(self._release.name, 'a latched message releases nothing: call ~estop')
            return
        try:
            self._begin(Wish.RELEASE_ESTOP)
        except ValueError as error:
            logerr(self._release.name, error)

    def _ask(self, wish: Wish) -> Tuple[bool, str]:
        """Ask the robot, and wait for its answer: (whether it does it, in words)."""
        try:
            request = self._begin(wish)
        except ValueError as error:
            return False, str(error)
        deadline = time.monotonic() + ANSWER_TIMEOUT
        with self._answered:
            outcome = self._outcome(request)
            while outcome is None and time.monotonic() < deadline and not rospy.is_shutdown():
                self._answered.wait(SHOW_PERIOD)
                outcome = self._outcome(request)
        if outcome is None:
            return False, 'the robot has not answered in %g s%s' % (
                ANSWER_TIMEOUT, ': it is asked until it does' if wish == Wish.ENGAGE_ESTOP else '')
        return not outcome, outcome or DONE[wish]

    def _begin(self, wish: Wish) -> int:
        """:raises ValueError: where the robot cannot be asked, or what is asked may have waited here"""
        now = time.monotonic()
        with self._worker.changing():
            stalled = self._stall.look(now)
            if stalled and wish != Wish.ENGAGE_ESTOP:
                raise ValueError(stalled)
            known = self._clock.robot_time(now)
            # the earliest time: what was asked before the robot's situation changed must not seem to be asked after it
            request = self._client.ask(wish, now, None if known is None else known.earliest)
        self._show.wake()
        return request

    def _outcome(self, request: int) -> Optional[str]:
        with self._worker.lock:
            return self._client.outcome(request)

    # -- the state in words ---------------------------------------------------------------------------

    def _show_state(self) -> None:
        now = time.monotonic()
        notice = self._notice_text(now)
        self._notice.show(view_text(notice, self.commanded))
        state = notice or self.outlook(now).refusal or free_state(self._commands)
        if state != self._state and not rospy.is_shutdown():
            self._state = state
            self._states.publish(state)

    def _notice_text(self, now: float) -> str:
        """What the views show; empty: nothing, commands leave, or there are none."""
        with self._worker.lock:
            estop, driving, status = self._client.estop, self._client.in_control(now), self._client.status
            heard = self._client.heard(now)
        reasons = {one.name: one.lock(now) for one in self._commands}
        if estop:
            return EMERGENCY_STOP
        if self._commands and heard and not driving and status is not None and status.driver:
            return 'NOT IN CONTROL: %s drives' % status.driver
        return lock_text(reasons)


def free_state(commands: Sequence[Commands]) -> str:
    """The state where nothing locks what comes."""
    if not commands:
        return NO_COMMANDS
    return FROM_REST if any(one.awaits_neutral for one in commands) else IN_CONTROL


def view_text(notice: str, commanded: bool) -> str:
    """What views show in red: that commands are locked concerns nobody before the first command of this desk.

    :param notice: the state in words; empty: commands leave
    :param commanded: whether there was a command
    """
    return notice if commanded or not notice.startswith(LOCKED) else ''


def lock_text(reasons: Mapping[str, Optional[str]]) -> str:
    """Which command streams are locked, and why; empty: none is. A stick that has to be let go of comes first.

    :param reasons: {stream: why it is locked, None: it is not}
    """
    locked = {name: reason for name, reason in reasons.items() if reason}
    if not locked:
        return ''
    name, reason = min(locked.items(), key=lambda item: not item[1].startswith(START_FROM_NEUTRAL))
    return LOCKED + (reason if len(locked) == len(reasons) else '%s: %s' % (name, reason))
