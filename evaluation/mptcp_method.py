# SPDX-License-Identifier: BSD-3-Clause
"""What sends the camera of `bench paths` beside the nodes: JPEG over the kernel's multipath TCP, see mptcp_peer."""
import pathlib
import subprocess
from typing import NamedTuple

from smokebot_udp.link_lab.lab import ADDRESSES
from smokebot_udp.link_lab.link_trace import SIDES
from smokebot_udp.link_lab.second_link import SECOND, SECOND_DEVICE

from .live_methods import PeerMethod
from .mptcp_peer import open_socket
from .stack import Stack

LIMITS = 'limits set subflows 4 add_addr_accepted 4'
SECOND_ADDRESS = 'endpoint add %s dev %s signal' % (SECOND['robot'], SECOND_DEVICE)
"""The robot announces its second address, to which the operator's routes lead by the second link."""


class Jpeg(NamedTuple):
    """How the images are sent."""
    quality: int
    """As cv2 has it, 0..100."""
    congestion_control: str
    """On each path of the connection."""


class MultipathTcp(PeerMethod):
    """JPEG over a connection with a path over each of two links.

    :raises RuntimeError: where this machine has no multipath TCP
    """

    def __init__(self, stack: Stack, images: pathlib.Path, jpeg: Jpeg) -> None:
        super().__init__(stack, images)
        try:
            open_socket().close()
        except OSError as error:
            raise RuntimeError('the kernel has no multipath TCP: %s' % error) from None
        for side in SIDES:
            self._mptcp(side, LIMITS)
        self._mptcp('robot', SECOND_ADDRESS)
        self.sender = self._collect('robot', ['evaluation.mptcp_peer', 'send', str(jpeg.quality),
                                              jpeg.congestion_control], self._once_ready(self._take))
        """The sender's process."""
        self._await_ready('the sender over multipath TCP')
        self._collect('operator', ['evaluation.mptcp_peer', 'receive', ADDRESSES['robot'], str(images)], self._show)

    def _mptcp(self, side: str, line: str) -> None:
        done = self.stack.lab.run(side, ['ip', 'mptcp', *line.split()], stderr=subprocess.PIPE)
        if done.returncode:
            raise RuntimeError('ip mptcp %s: %s' % (line, done.stderr.decode().strip()))
