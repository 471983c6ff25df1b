# SPDX-License-Identifier: BSD-3-Clause
"""The nodes as shipped, and a camera that shows the clip, over one link of the lab or over two at once.

Own masters, sealed. What is seen of it is judged as in `bench live`.
"""
import pathlib
import time
from typing import Any, List, Mapping, NamedTuple, Optional

from smokebot_udp.link_lab.lab import Lab
from smokebot_udp.link_lab.second_link import second_lab

from .live_methods import Nodes
from .live_run import await_image, quality_of, scene_begins
from .live_score import Screen
from .needs_run import processor_time
from .own_masters import OwnMasters
from .path_cuts import ADDRESSES
from .started import Started

Conditions = Mapping[str, float]
"""Conditions of a link, as link_lab has them."""


class Moment(NamedTuple):
    """The counters at a time."""
    time: float
    """By time.time() [s]."""
    carried: List[int]
    """By each link to the operator [byte]."""
    cpu: float
    """Processor time of robot_sender [s]."""


class Seen(NamedTuple):
    """What was seen between two moments."""
    screen: Screen
    begun: float
    ended: float
    carried: List[float]
    """By each link to the operator [Mbit/s]."""
    cpu: float
    """Processor time of robot_sender, in cores."""


class PathRun(Started):
    """The nodes and the links; a context manager.

    :param first, second: conditions of the links; the second one may be missing
    :param folder: where images are recorded while it lasts
    :param log: file for the output of both sides
    :raises LabError: as Lab
    """

    def __init__(self, first: Conditions, second: Optional[Conditions], folder: pathlib.Path, log: pathlib.Path,
                 seed: int = 1) -> None:
        super().__init__()
        self._images = folder / 'screen'
        log.write_bytes(b'')
        with self.starting():
            self.stack = self.enter_context(OwnMasters(log=log, sides=Lab(seed)))
            self.links: List[Any] = [self.stack.lab]
            self.stack.lab.set({**first})
            if second is not None:
                self.links.append(self.enter_context(second_lab(self.stack.lab, seed + 1)))
                self.links[1].set({**second})
                self.stack.addresses = ','.join(ADDRESSES)
            self.method = Nodes(self.stack, self._images, folder / 'trace')

    def settle(self, seconds: float) -> None:
        """Wait for the first image, and then some time, with the camera of all runs at the same scene.

        :raises RuntimeError: where no image comes
        """
        await_image(self.method, 'camera')
        time.sleep(max(0.0, scene_begins(self.method) + seconds - time.time()))

    def moment(self) -> Moment:
        """The counters now."""
        return Moment(time.time(), [link.counts()['robot']['carried'] for link in self.links],
                      processor_time(self.method.sender.pid))

    def seen(self, begun: Moment, ended: Moment) -> Seen:
        """What was seen between two moments; nothing is sent any more."""
        taken, shown = list(self.method.taken), self.method.shown()
        self.stack.end_all()
        passed = ended.time - begun.time
        carried = [8e-6 * (after - before) / passed for before, after in zip(begun.carried, ended.carried)]
        return Seen(Screen(taken, shown, quality_of(self._images)), begun.time, ended.time, carried,
                    (ended.cpu - begun.cpu) / passed)
