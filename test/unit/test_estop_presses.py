# SPDX-License-Identifier: BSD-3-Clause
"""Two operators press the emergency stop, release it, and press it again, while links fail and nodes are restarted: no
press that a person made after the last release is ever lost."""
from typing import Any, Dict, List, NamedTuple, Tuple

from control_world import World
from hypothesis import example, given, settings
from hypothesis import strategies as st

from smokebot_udp.teleop.records import Status, Wish

A, B, ROBOT = 'a', 'b', 'the robot'


class Press(NamedTuple):
    """A press of the emergency stop by a person."""
    session: int
    """Session of the operator's node; 0: it was pressed at the robot."""
    request: int
    """Id of the request."""
    when: float
    """Time of the press [s]."""


class Presses(World):
    """Notes when each release that took effect was asked, and which presses have to count."""

    def __init__(self, seed: int, loss: float) -> None:
        super().__init__(seed, loss=loss, duplicates=0.2, held_up=0.1)
        self.count: List[Press] = []
        """The presses since the last release, of those that some node that runs has to know."""
        self._asked: Dict[Tuple[int, int], float] = {}      # {(session, id of a release): when}
        self._arrived: List[Tuple[int, int]] = []       # (session, id) of the presses that came to the robot
        self._ended: List[int] = []         # sessions of operators' nodes that were restarted
        for name in (A, B):
            self.add(name)
        self.run(1.0)

    def press(self, name: str) -> None:
        request = self.ask(name, Wish.ENGAGE_ESTOP)
        self.count.append(Press(self.desks[name].client.session, request, self.now))

    def release(self, name: str) -> None:
        session = self.desks[name].client.session
        try:
            request = self.desks[name].client.ask(Wish.RELEASE_ESTOP, self.desk_now(name), self.robot_time(name))
        except ValueError:      # the robot cannot be asked now, and the person is told so
            return
        self._asked[session, request] = self.now
        self.flush()

    def press_at_the_robot(self, engaged: bool) -> None:
        self.server.set_estop(engaged, ROBOT, self.robot_now)
        self.count = [] if not engaged else self.count + [Press(0, 0, self.now)]
        self._arrived.append((0, 0))

    def restart_desk(self, name: str) -> None:
        """End an operator's node, and start it again: only the robot knows of a press that has come to it."""
        ended = self.desks[name].client.session
        self.count = [press for press in self.count if press.session != ended or self._has_come(press)]
        self._ended.append(ended)
        self.add(name)

    def respawn_robot(self) -> None:
        """robot_sender keeps who engaged the stop."""
        estop = self.server.estop
        self.restart_robot()
        if estop.engaged:
            self.server.set_estop(True, estop.by, self.robot_now)

    def launch_robot(self) -> None:
        """A new start of robot.launch keeps nothing: only operators' nodes know of presses."""
        self.restart_robot()
        self._arrived = []
        self.count = [press for press in self.count if press.session not in [0, *self._ended]]

    def _has_come(self, press: Press) -> bool:
        """Whether a press has come to the robot, or one after it of the same node."""
        return any(session == press.session and request >= press.request for session, request in self._arrived)

    def arrive(self, name: str, datagram: Any) -> None:
        before = self.server.estop.engaged
        super().arrive(name, datagram)
        if not isinstance(datagram, Status) and datagram[1].id:
            request = datagram[1]
            if request.wish == Wish.ENGAGE_ESTOP:
                self._arrived.append((request.session, request.id))
            if before and not self.server.estop.engaged:
                asked = self._asked[request.session, request.id]
                self.count = [press for press in self.count if press.when > asked]

    def settle(self) -> None:
        """The link is good, and stays so until all know the same."""
        self.loss = self.duplicates = self.held_up = 0.0
        for failures in (self.cut, self.mute, self.deaf):
            failures.update(dict.fromkeys(failures, False))
        self.run(8.0)


def fail(link: World, what: str, name: str) -> None:
    failures = getattr(link, what)
    failures[name] = not failures[name]


ACTS: Dict[str, Any] = {
    'press': lambda link, name: link.press(name),
    'release': lambda link, name: link.release(name),
    'cut': lambda link, name: fail(link, 'cut', name),
    'deaf': lambda link, name: fail(link, 'deaf', name),
    'mute': lambda link, name: fail(link, 'mute', name),
    'restart': lambda link, name: link.restart_desk(name),
    'respawn robot': lambda link, _: link.respawn_robot(),
    'launch robot': lambda link, _: link.launch_robot(),
    'press at the robot': lambda link, _: link.press_at_the_robot(True),
    'release at the robot': lambda link, _: link.press_at_the_robot(False),
}
OFTEN = 3 * ['press', 'release'] + ['deaf', 'mute']

Events = List[Tuple[str, str, float]]
EVENTS = st.lists(st.tuples(st.sampled_from([*OFTEN, *ACTS]), st.sampled_from([A, B]),
                            st.sampled_from([0.0, 0.02, 0.1, 0.4, 1.5])), min_size=2, max_size=16)
"""(what happens, to which operator, time until the next [s])"""


@settings(max_examples=1000, deadline=None)
@given(seed=st.integers(0, 1 << 30), loss=st.sampled_from([0.0, 0.3, 0.6, 0.8]), events=EVENTS)
@example(seed=1, loss=0.0, events=[('deaf', A, 0.0), ('press', A, 0.4), ('release', B, 0.4), ('press', A, 0.4)])
def test_no_press_after_the_last_release_is_lost(seed: int, loss: float, events: Events) -> None:
    link = Presses(seed, loss)
    for what, name, pause in events:
        ACTS[what](link, name)
        link.run(pause)
    link.settle()
    engaged = link.server.estop.engaged
    assert engaged or not link.count, link.count
    assert all(desk.client.estop == engaged for desk in link.desks.values())
