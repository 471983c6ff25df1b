# SPDX-License-Identifier: BSD-3-Clause
"""A Stack in which each side has a master of its own: only the link's UDP port joins them.

Within a side, ROS knows its machine as localhost, so that it does not matter which address the machine has.
"""
import os
import pathlib
import subprocess
import tempfile
import time
from typing import Any, Dict, Optional

from smokebot_udp.link.keys import make_key
from smokebot_udp.link_lab.lab import ADDRESSES, TwoSides

from .firewall import Firewall
from .stack import RECEIVER, SENDER, Stack

PORT = 17001
"""The robot's."""

ROBOT = '%s:%d' % (ADDRESSES['robot'], PORT)

MASTER = 'http://localhost:11311'

POLLING = 0.005
"""[s]"""


class OwnMasters(Stack):
    """See Stack.

    :param shared_air, sides: see Stack
    """

    MASTER_SIDES = 'robot', 'operator'

    def __init__(self, seed: int = 0, log: Optional[pathlib.Path] = None, shared_air: bool = False,
                 sides: Optional[TwoSides] = None) -> None:
        super().__init__(seed, log=log, shared_air=shared_air, sides=sides)
        folder = self._resources.enter_context(tempfile.TemporaryDirectory())
        self.key_file = os.path.join(folder, 'link.key')
        """Key of both sides."""
        self.addresses = ROBOT
        """Addresses of the robot, in order of preference, as operator_receiver's `robot`."""
        make_key(self.key_file)

    def environment(self, side: str) -> Dict[str, str]:
        rest = {name: value for name, value in os.environ.items() if name != 'ROS_IP'}
        return {**rest, 'ROS_HOSTNAME': 'localhost', 'ROS_MASTER_URI': MASTER}

    def start_sender(self, *arguments: str) -> 'subprocess.Popen[Any]':
        """Start robot_sender, which listens on the port."""
        return self.start_node('robot', SENDER, '_link_port:=%d' % PORT, '_key_file:=' + self.key_file,
                               *arguments)

    def start_receiver(self, *arguments: str, robot: str = '', key_file: str = '') -> 'subprocess.Popen[Any]':
        """Start operator_receiver, which joins a robot.

        :param robot: empty: `addresses`
        :param key_file: of that robot; empty: of this one
        """
        return self.start_node('operator', RECEIVER, '_robot:=' + (robot or self.addresses),
                               '_key_file:=' + (key_file or self.key_file), *arguments)

    def firewalls(self) -> Dict[str, Firewall]:
        """{side: a firewall that passes only the port}, in force from now on."""
        return {side: Firewall(self.lab, side, PORT) for side in self.MASTER_SIDES}

    def wait_for_port(self, timeout: float = 30.0) -> float:
        """When the robot listens (time.time()).

        :param timeout: [s]
        :raises RuntimeError: where it does not
        """
        deadline = time.monotonic() + timeout
        sockets = pathlib.Path('/proc/%d/net/udp' % self.masters['robot'].pid)
        while ':%04X ' % PORT not in sockets.read_text():
            if time.monotonic() > deadline:
                raise RuntimeError('nobody listens on the port %d' % PORT)
            time.sleep(POLLING)
        return time.time()
