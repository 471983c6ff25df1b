# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of control: who drives, and the emergency stop, as operators ask and as a person at the robot does.

teleop/control_server.py decides. Operators ask on REQUEST, and all of them get the status on STATUS. ~estop (latched)
shows whether the emergency stop is engaged. Service: ~set_estop, for a person or a program at the robot. The parameter
~estop_by keeps who engaged it: a node that is started again, as after a crash, has not released it.
"""
import contextlib
import random
import time
from typing import Any, Callable, Dict, FrozenSet, Iterable, Iterator, List, NamedTuple, Optional, Tuple

import rospy
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, SetBoolResponse

from ..limited_log import logerr
from ..monitoring.node_status import robot_control_status
from ..monitoring.status import Status
from ..msg import ControlPeer, ControlRequest, ControlStatus
from ..teleop import records
from ..teleop.control_server import ControlServer
from ..traffic import EXPEDITED
from ..transport import Transport
from ..udpros import rpc
from .logging import log_error
from .opened import Part
from .outbox import Outbox
from .worker import DeadlineWorker, PeriodicWorker

REQUEST, STATUS = '/smokebot_udp/control/request', '/smokebot_udp/control/status'
"""Wire topics."""

PEERS_PERIOD = 0.25
"""How often the ends of operators' links are looked for; one that is missing twice in a row has ended [s]."""

KEPT = '~estop_by'
"""Parameter with who engaged the emergency stop; empty: it is not engaged."""

KEEP_PERIOD = 5.0
"""Time until the parameter is set again where the master did not answer [s]."""

AT_THE_ROBOT = 'somebody at the robot'
"""Who calls ~set_estop."""


class Standing(NamedTuple):
    """Who drives at one moment."""
    driver: str = ''
    """Name of the operator; empty: nobody."""
    session: int = 0
    """Its session; 0: nobody."""
    estop: bool = False
    """Whether the emergency stop is engaged."""
    estop_by: str = ''
    """Who engaged it last."""
    releases: int = 0
    """How often it was released."""
    operators: Tuple[str, ...] = ()
    """Names of all that are present."""

    def refusal(self, operator: str) -> Optional[str]:
        """Why an operator may not have the robot move; None: it may."""
        if self.estop:
            return 'the emergency stop is engaged'
        if operator != self.driver:
            return 'not in control: %s drives' % (self.driver or 'nobody')
        return None


class RobotControl(Part):
    """Serves the requests of operators and sends them ControlStatus; lives as long as its node. Any thread may use it.

    :param outbox: whose rate pays for what is sent
    """

    def __init__(self, transport: Transport, outbox: Outbox) -> None:
        super().__init__()
        self.session = random.randint(1, 2 ** 32 - 1)
        """Session of this node: a random number other than 0."""
        self._outbox = outbox
        self._server = ControlServer(self.session)
        self._standing = Standing()
        self._listeners: List[Callable[[], None]] = []
        self._peers: FrozenSet[str] = frozenset()
        self._missing: FrozenSet[str] = frozenset()     # operators without a connection when last looked for
        self._log = log = log_error('control')
        opened = self._opened
        self._worker: DeadlineWorker[Tuple[Optional[records.Status], bool]] = DeadlineWorker(
            'control', self._poll, self._server.deadline, self._send, log)
        self._estop = opened.topic(rospy.Publisher('~estop', Bool, queue_size=1, latch=True))
        self._show = PeriodicWorker('estop', self._show_estop, log, None)   # not in the transport's thread
        self._statuses = opened.topic(transport.publisher(STATUS, ControlStatus, queue_size=1, tos=EXPEDITED,
                                                           copied=True))
        self._keep = PeriodicWorker('kept estop', self._keep_estop, log, KEEP_PERIOD)
        self._kept = str(rpc.repeated(lambda: rospy.get_param(KEPT, '')))
        if self._kept:
            self._server.set_estop(True, self._kept, time.monotonic())
            self._follow()
        self._show.wake()
        for worker in (self._worker, self._keep, self._show,
                       PeriodicWorker('operators', self._watch_peers, log, PEERS_PERIOD)):
            opened.started(worker)
        rospy.Service('~set_estop', SetBool, self._set_estop)
        opened.topic(transport.subscriber(REQUEST, ControlRequest, self._receive))

    @property
    def standing(self) -> Standing:
        """Who drives now."""
        return self._standing

    def subscribe(self, listener: Callable[[], None]) -> None:
        """Call listener() after each change of `standing`, in any thread and without a lock; it has to be short."""
        self._listeners = [*self._listeners, listener]

    def command(self, name: str, session: int, topic: str, seq: int) -> Optional[str]:
        """A command came: its operator is present.

        :param name: of the operator's node, as the transport knows it
        :param topic, seq: its wire topic, and its number there
        :return: why it is not carried out; None: it may be
        """
        with self._changing():
            return self._server.command(name, session, topic, seq, time.monotonic())

    def reported(self, name: str, seq: int) -> None:
        """A link report of an operator came: it is present."""
        with self._changing():
            self._server.reported(name, seq, time.monotonic())

    def status(self, now: float) -> Status:
        """For diagnostics."""
        standing = self._standing
        with self._worker.lock:
            dropped = dict(self._server.dropped)
        return robot_control_status(standing.driver, standing.estop_by if standing.estop else None,
                                    standing.operators, dropped)

    @contextlib.contextmanager
    def _changing(self) -> Iterator[None]:
        """Hold the lock to change who drives; listeners are called at the end, without it."""
        with self._worker.adding():
            yield
            changed = self._follow()
        if changed:
            self._tell()

    def _follow(self) -> bool:
        """Update `standing`, under the lock; whether it has changed."""
        before, driver, estop = self._standing, self._server.control.driver, self._server.estop
        self._standing = Standing(driver.name if driver else '', driver.session if driver else 0, estop.engaged,
                                  estop.by, estop.releases, tuple(one.name for one in self._server.control.operators))
        return self._standing != before

    def _tell(self) -> None:
        call_each(self._listeners, self._log)
        self._show.wake()
        self._keep.wake()

    def _receive(self, message: Any) -> None:
        """Serve a request; the transport's thread."""
        name = message._connection_header['callerid']
        try:
            request = records.Request.of(message)
        except ValueError as error:
            logerr('a request of %s is not served' % name, error)
            return
        with self._changing():
            self._server.receive(name, message.header.seq, request, time.monotonic())

    def _poll(self, now: float) -> Optional[Tuple[Optional[records.Status], bool]]:
        """What is to be sent now, and whether somebody has to be told that `standing` has changed."""
        status = self._server.poll(now)
        changed = self._follow()
        return (status, changed) if status is not None or changed else None

    def _send(self, due: Tuple[Optional[records.Status], bool]) -> None:
        status, changed = due
        if changed:
            self._tell()
        if status is None:
            return
        self._outbox.publish_message(self._statuses, status_message(status))

    def _watch_peers(self) -> None:
        """Note whose link has ended."""
        peers = frozenset(connection['peer'] for connection in self._statuses.connections())
        missing = self._peers - peers
        gone = missing & self._missing
        self._peers, self._missing = (self._peers | peers) - gone, missing - gone
        for name in gone:
            with self._changing():
                self._server.left(name)

    def _set_estop(self, asked: Any) -> Any:
        """Serve SetBool."""
        with self._changing():
            self._server.set_estop(bool(asked.data), AT_THE_ROBOT, time.monotonic())
        return SetBoolResponse(True, 'the emergency stop is %s' % ('engaged' if asked.data else 'released'))

    def _show_estop(self) -> None:
        standing = self._standing
        if not rospy.is_shutdown():
            self._estop.publish(standing.estop)

    def _keep_estop(self) -> None:
        standing = self._standing
        engaged_by = standing.estop_by if standing.estop else ''
        if engaged_by != self._kept and not rospy.is_shutdown():
            rospy.set_param(KEPT, engaged_by)
            self._kept = engaged_by
            rospy.logwarn('the emergency stop is %s', 'engaged by ' + engaged_by if engaged_by else 'released')


def call_each(listeners: Iterable[Callable[[], None]], on_error: Callable[[Exception], None]) -> None:
    """Call all listeners, also where one fails: the others may have to stop the robot."""
    for listener in listeners:
        try:
            listener()
        except Exception as error:
            on_error(error)


def status_message(status: Any) -> Any:
    """The ControlStatus of a records.Status."""
    fields: Dict[str, Any] = status.fields()
    for name in 'operators', 'others':
        fields[name] = [ControlPeer(**peer.fields()) for peer in fields[name]]
    return ControlStatus(**fields)
