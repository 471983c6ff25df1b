# SPDX-License-Identifier: BSD-3-Clause
"""Both ends of a link in one process, over real sockets, for runners of services and actions."""
import pathlib
import sys
from dataclasses import replace
from typing import Any, Callable

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / 'unit'))
from link_pair import Links
from udp_cable import UdpCable

from smokebot_udp import udpros
from smokebot_udp.nodes.reliable_link import ReliableLink
from smokebot_udp.nodes.robot_control import Standing
from smokebot_udp.nodes.way import OperatorWay, RobotWay

OPERATOR = '/operator_receiver@desk1'


class FixedControl:
    """What streams see of RobotControl and OperatorControl: the operator drives."""

    def __init__(self, session: int) -> None:
        self.session, self.standing = session, Standing(driver=OPERATOR)
        self._listener: Callable[[], None] = lambda: None

    def subscribe(self, listener: Callable[[], None]) -> None:
        self._listener = listener

    def change(self, **fields: Any) -> None:
        """Change the standing."""
        self.standing = self.standing._replace(**fields)
        self._listener()


class ReliablePair:
    """A robot and an operator that lose datagrams on arrival; `robot` and `operator` are what streams are made of.

    :param loss: 0..1, in each direction
    """

    def __init__(self, loss: float = 0.0) -> None:
        udpros.emulate_loss(loss, 1)
        self._links, self._sessions = Links(), 1
        self._transport, _ = self._links.robot()
        self.control = FixedControl(self._sessions)
        self.robot: Any = self._robot_way()
        self.cable = UdpCable(self._transport.port)
        transport, _ = self._links.operator(self.cable.port, OPERATOR)
        link = ReliableLink(transport, 'operator')
        link.start()
        self.operator: Any = OperatorWay(transport, FixedControl(100), link, '', lambda *_: None)

    def _robot_way(self) -> Any:
        link = ReliableLink(self._transport, 'robot')
        link.start()
        return RobotWay(self._transport, self.control, link)

    def prefix_frames(self, prefix: str) -> None:
        """For the operator's streams that are made from now on."""
        self.operator = replace(self.operator, frame_prefix=prefix)

    def end_robot(self) -> None:
        """End the robot's node."""
        self.robot.reliable.close()
        self._transport.close()
        self._links.made.remove(self._transport)

    def restart_robot(self) -> None:
        """The robot's node is another one now; its streams have to be made again."""
        self.end_robot()
        self._sessions += 1
        self.control = FixedControl(self._sessions)
        self._transport, _ = self._links.robot(self._transport.port)
        self.robot = self._robot_way()

    def close(self) -> None:
        self.operator.reliable.close()
        if self._transport in self._links.made:
            self.end_robot()
        self._links.close()
        self.cable.close()
        udpros.emulate_loss(0.0)
