# SPDX-License-Identifier: BSD-3-Clause
"""The nodes as shipped, or a peer, and a camera that shows the clip, over one link or over two at once.

Own masters, sealed. What is seen of it is judged as in `bench live`.
"""
import pathlib
import time
from typing import List, NamedTuple, Optional, Union

from .live_methods import Nodes
from .live_run import await_image, quality_of, scene_begins
from .live_score import Screen
from .mptcp_method import Jpeg, MultipathTcp
from .needs_run import processor_time
from .own_masters import OwnMasters
from .path_cuts import ADDRESSES
from .path_links import LabLinks, ShapedLinks
from .started import Started


class Moment(NamedTuple):
    """The counters at a time."""
    time: float
    """By time.time() [s]."""
    carried: List[int]
    """By each link to the operator [byte]."""
    cpu: float
    """Processor time of the sender [s]."""


class Seen(NamedTuple):
    """What was seen between two moments."""
    screen: Screen
    begun: float
    ended: float
    carried: List[float]
    """By each link to the operator [Mbit/s]."""
    cpu: float
    """Processor time of the sender, in cores."""


class PathRun(Started):
    """Both sides of a sender, which ends with them; a context manager.

    :param links: between the sides
    :param folder: where images are recorded while it lasts
    :param log: file for the output of both sides
    :param jpeg: of the peer; None: the nodes send
    :raises RuntimeError: where the peer does not start
    """

    def __init__(self, links: Union[LabLinks, ShapedLinks], folder: pathlib.Path, log: pathlib.Path,
                 jpeg: Optional[Jpeg] = None) -> None:
        super().__init__()
        self._links = links
        self._images = folder / 'screen'
        log.write_bytes(b'')
        with self.starting():
            self.stack = self.enter_context(OwnMasters(log=log, sides=links.sides))
            self.stack.addresses = ','.join(ADDRESSES[:links.count])
            self.method: Union[Nodes, MultipathTcp] = (
                Nodes(self.stack, self._images, folder / 'trace') if jpeg is None else
                MultipathTcp(self.stack, self._images, jpeg))

    def settle(self, seconds: float) -> None:
        """Wait for the first image, and then some time, with the camera of all runs at the same scene.

        :raises RuntimeError: where no image comes
        """
        await_image(self.method, 'the camera')
        time.sleep(max(0.0, scene_begins(self.method) + seconds - time.time()))

    def moment(self) -> Moment:
        """The counters now."""
        return Moment(time.time(), self._links.carried(), processor_time(self.method.sender.pid))

    def seen(self, begun: Moment, ended: Moment) -> Seen:
        """What was seen between two moments; nothing is sent any more."""
        taken, shown = list(self.method.taken), self.method.shown()
        self.stack.end_all()
        passed = ended.time - begun.time
        carried = [8e-6 * (after - before) / passed for before, after in zip(begun.carried, ended.carried)]
        return Seen(Screen(taken, shown, quality_of(self._images)), begun.time, ended.time, carried,
                    (ended.cpu - begun.cpu) / passed)
