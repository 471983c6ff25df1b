# SPDX-License-Identifier: BSD-3-Clause
"""Two robots, each with a master and an emulated link of its own, and one desk with its master."""
import pathlib
from typing import Any, Dict, Optional

from smokebot_udp.link_lab.lab import DEVICE
from smokebot_udp.link_lab.second_link import SECOND, join_end

from .own_masters import PORT, OwnMasters
from .started import Started

NAMES = 'ugv1', 'ugv2'
ROBOTS = {'ugv1': '10.77.0.1:%d' % PORT, 'ugv2': '%s:%d' % (SECOND['robot'], PORT)}


class TwoRobots(Started):
    """The desk is the operator's side of the first robot's stack; a context manager.

    `stacks` by name: the second one has a robot's side and a link only.

    :param seed: of the links
    :param log: see OwnMasters
    :raises LabError: as Lab
    """

    def __init__(self, seed: int, log: Optional[pathlib.Path] = None) -> None:
        super().__init__()
        self.stacks: Dict[str, OwnMasters] = {}
        with self.starting():
            for number, name in enumerate(NAMES):
                self.stacks[name] = self.enter_context(OwnMasters(seed + number, log))
            self.desk, second = self.stacks.values()
            self._join_desk(second)

    def _join_desk(self, second: OwnMasters) -> None:
        """Move the second link's end into the desk's namespace, and give it addresses of its own."""
        join_end(second.lab, 'operator', self.desk.lab)
        second.ip('robot', 'addr flush dev %s' % DEVICE)
        second.ip('robot', 'link set %s up' % DEVICE)
        second.ip('robot', 'addr add %s peer %s dev %s' % (SECOND['robot'], SECOND['operator'], DEVICE))

    def start_receiver(self, name: str, *arguments: str) -> Any:
        """Start operator_receiver at the desk for a robot, in a namespace of the robot's name."""
        return self.desk.start_receiver('__ns:=/' + name, *arguments, robot=ROBOTS[name],
                                        key_file=self.stacks[name].key_file)
