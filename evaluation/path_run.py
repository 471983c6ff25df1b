# SPDX-License-Identifier: BSD-3-Clause
"""The nodes as shipped, and a camera that shows the clip, over one link of the lab or over two at once.

Own masters, sealed. What is seen of it is judged as in `bench live`.
"""
import pathlib
import time
from typing import Any, List, Mapping, NamedTuple, Optional

import numpy as np
import psutil

from smokebot_udp.arrays import Array
from smokebot_udp.link_lab.lab import Lab
from smokebot_udp.link_lab.second_link import SECOND, second_lab

from .live_clip import HEIGHT, WIDTH, Clip
from .live_methods import Nodes
from .live_run import BEGUN, START_TIMEOUT, remembered
from .live_score import Screen
from .own_masters import PORT, ROBOT, OwnMasters
from .quality import psnr
from .started import Started
from .video_clips import RATE

Conditions = Mapping[str, float]
"""Conditions of a link, as link_lab has them."""

BOTH = '%s,%s:%d' % (ROBOT, SECOND['robot'], PORT)


class Moment(NamedTuple):
    """The counters at a time."""
    time: float
    """By time.time() [s]."""
    carried: List[int]
    """By each link to the operator [byte]."""
    cpu: float
    """Processor time of robot_sender [s]."""


def cpu_seconds(process: int) -> float:
    """What a process and its children have used [s]."""
    running = psutil.Process(process)
    times = [one.cpu_times() for one in [running, *running.children(recursive=True)]]
    return float(sum(one.user + one.system for one in times))


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
                self.stack.addresses = BOTH
            self.method = Nodes(self.stack, self._images, folder / 'trace')

    def settle(self, seconds: float) -> None:
        """Wait for the first image, and then some time, with the camera of all runs at the same scene.

        :raises RuntimeError: where no image comes
        """
        deadline = time.monotonic() + START_TIMEOUT
        while not self.method.shown():
            if time.monotonic() > deadline:
                raise RuntimeError('no image comes: see the log')
            time.sleep(0.05)
        begun = self.method.taken[0].stamp - self.method.taken[0].number / RATE + BEGUN
        time.sleep(max(0.0, begun + seconds - time.time()))

    def moment(self) -> Moment:
        """The counters now."""
        return Moment(time.time(), [link.counts()['robot']['carried'] for link in self.links],
                      cpu_seconds(self.method.sender.pid))

    def seen(self, begun: Moment, ended: Moment) -> Seen:
        """What was seen between two moments; nothing is sent any more."""
        taken, shown = list(self.method.taken), self.method.shown()
        self.stack.end_all()
        images: Array = np.fromfile(str(self._images), np.uint8)
        images = images[:len(images) // (HEIGHT * WIDTH) * HEIGHT * WIDTH].reshape(-1, HEIGHT, WIDTH)
        clip, passed = Clip(), ended.time - begun.time
        quality = remembered(lambda number, place: psnr(clip.image(number), images[place]))
        carried = [8e-6 * (after - before) / passed for before, after in zip(begun.carried, ended.carried)]
        return Seen(Screen(taken, shown, quality), begun.time, ended.time, carried, (ended.cpu - begun.cpu) / passed)
