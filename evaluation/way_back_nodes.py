# SPDX-License-Identifier: BSD-3-Clause
"""The nodes of both sides over an emulated link, and what drives the robot by the way back.

On the robot's side run sensor_source and robot_sender, on the operator's side operator_receiver. On both sides run a
Teleoperator, which sends, and a listener of teleoperated, which reports what came.
"""
import itertools
import pathlib
import random
import time
from typing import Any, Dict, Iterator, List, Mapping, Tuple

from . import teleoperated
from .link_run import AIR, SensorSource, lab_state
from .listener import Listener, Subscription
from .own_masters import RECEIVER, SENDER, OwnMasters
from .polling import wait_for
from .stack import Stack
from .started import Started
from .teleoperator import Teleoperator
from .way_back_results import HALF_ROUND_TRIP, Log

GOOD = {'loss': 0.0, 'burst': 0.0, 'jitter': 0.0, 'reorder': 0.0, 'duplicate': 0.0, 'delay': HALF_ROUND_TRIP, **AIR}

STREAMS = pathlib.Path(__file__).with_name('way_back_streams.yaml')
IMAGES, OPERATOR_IMAGES = 'camera/image_raw', '/operator/camera/image_raw'
SPEED, ESTOP = '/cmd_vel', '/robot_sender/estop'
TOPICS: Dict[str, List[Subscription]] = {
    'robot': [[SPEED, 'speed', 'TCPROS'], [ESTOP, 'flag', 'TCPROS'], ['/to_robot', 'number', 'TCPROS'],
              ['/brief_to_robot', 'number', 'TCPROS']],
    'operator': [[OPERATOR_IMAGES, 'image', 'TCPROS'], ['/operator/to_operator', 'number', 'TCPROS'],
                 ['/operator/brief_to_operator', 'number', 'TCPROS']]}
"""{side: what its listener hears}"""

SENT = {'robot': ['/to_operator', '/brief_to_operator'], 'operator': ['/operator/to_robot', '/operator/brief_to_robot']}
"""{side: topics of reliable messages}"""

STARTING = 60.0
SETTLE = 3.0
"""Until the nodes know the loss of a new link, and rates follow it [s]."""

TIMEOUT = 10.0
"""What has not happened by then over a bad link never will [s]."""

REST = 1.0
"""What was sent has arrived by then, or never will [s]."""

POLLING = 0.005
DISORDER = 1.0
"""Messages of several topics are in order, but for this time [s]."""


class WayBackNodes(Started):
    """A context manager.

    :param folder: for files
    :param seed: of the link, and of `random`
    :param own_masters: whether each side has a master, and the link a key; otherwise UDPROS over a shared master
    :param shared_air: see Stack
    :raises LabError: as Lab
    """

    def __init__(self, folder: pathlib.Path, seed: int, own_masters: bool = True, shared_air: bool = False) -> None:
        super().__init__()
        self.random = random.Random(seed)
        self.log = folder / 'nodes.log'
        """What all of them write."""
        with self.starting():
            self._stack = self.enter_context(
                OwnMasters(seed, self.log, shared_air) if own_masters
                else Stack(seed, log=self.log, shared_air=shared_air))
            self._start()

    def _start(self) -> None:
        self.set_link({})
        self._source = SensorSource(self._stack)
        self._listeners = {side: Listener(self._stack, side, teleoperated.MODULE) for side in TOPICS}
        self.teleoperators = {side: self._teleoperator(side) for side in TOPICS}
        """{side: what sends there}"""
        self._start_node('robot', SENDER)
        self.start_receiver()
        for side, listener in self._listeners.items():
            listener.subscribe(TOPICS[side])
        self._source.wait()
        self.drive(STARTING)
        self.rest()

    def _teleoperator(self, side: str) -> Teleoperator:
        teleoperator = Teleoperator(self._stack, side, SENT[side], self.log)
        self.callback(teleoperator.close)
        return teleoperator

    def _start_node(self, side: str, name: str) -> Any:
        streams = '_streams_file:=%s' % STREAMS
        if isinstance(self._stack, OwnMasters):
            start = self._stack.start_sender if name == SENDER else self._stack.start_receiver
            return start(streams)
        return self._stack.start_node(side, name, streams)

    def start_receiver(self) -> None:
        """Start operator_receiver."""
        self._receiver = self._start_node('operator', RECEIVER)

    def kill_receiver(self) -> None:
        """Kill it, as by kill -9."""
        self._stack.end(self._receiver)

    def set_link(self, conditions: Mapping[str, float]) -> None:
        """Change the link: GOOD, but for these conditions."""
        self.conditions = {**GOOD, **conditions}
        self._stack.lab.set(self.conditions)

    def cut(self, seconds: float) -> Iterator[float]:
        """Cut the link for this time: when it was cut, and when it is no longer."""
        self._stack.lab.set({**self.conditions, 'loss': 1.0})
        begun = time.time()
        yield begun
        time.sleep(max(0.0, begun + seconds - time.time()))
        self._stack.lab.set(self.conditions)
        yield time.time()

    def state(self) -> Dict[str, float]:
        """lab_state of the link."""
        return lab_state(self._stack.lab)

    def counts(self) -> Dict[str, Any]:
        """Lab.counts."""
        return self._stack.lab.counts()

    def fill(self, filled: bool) -> None:
        """Whether images fill the link from now on.

        :raises RuntimeError: where none arrives
        """
        self._source.publish(IMAGES if filled else '')
        if filled and not self._listeners['operator'].first([OPERATOR_IMAGES], STARTING):
            raise RuntimeError('no image comes: see nodes.log')

    def heard(self, side: str, topic: str, since: float) -> List[Tuple[Any, float]]:
        """[(amount, when)] of the messages heard on a topic since a time."""
        recent = itertools.takewhile(lambda heard: heard.arrival > since - DISORDER,
                                     reversed(self._listeners[side].heard))
        return [(heard.amount, heard.arrival) for heard in recent
                if heard.topic == topic and heard.arrival >= since][::-1]

    def speeds(self, since: float) -> Log:
        """The commands that the robot obeyed since a time."""
        return [(int(number), at) for number, at in self.heard('robot', SPEED, since)]

    def drive(self, timeout: float = TIMEOUT) -> None:
        """Drive from now on, until the robot moves; again from zero where it does not.

        :raises RuntimeError: where it does not within the timeout [s]
        """
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            self.teleoperators['operator'].drive()
            if self.moves():
                return
        raise RuntimeError('the robot does not obey: see nodes.log')

    def moves(self) -> bool:
        """Wait until the robot obeys a command that moves it; whether it does within REST."""
        since = time.time()
        return bool(wait_for(lambda: any(number for number, _ in self.speeds(since)), REST, POLLING))

    def rest(self) -> Log:
        """Drive no more; what was sent since the last rest."""
        sent = self.teleoperators['operator'].rest()
        time.sleep(REST)
        return sent

    def settle(self, conditions: Mapping[str, float]) -> float:
        """Drive over a link with these conditions until the nodes know it; when that began."""
        begun = time.time()
        self.set_link(conditions)
        self.drive(STARTING)
        time.sleep(SETTLE)
        self.state()
        return begun
