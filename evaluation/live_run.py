# SPDX-License-Identifier: BSD-3-Clause
"""One method on one link of `bench live`: starts both sides, watches the screen and the link, and ends them."""
import pathlib
import time
from typing import Any, Callable, Dict, List, NamedTuple, Sequence, Tuple, Type

import numpy as np

from smokebot_udp.arrays import Array
from smokebot_udp.link_lab.lab import TwoSides
from smokebot_udp.monitoring.stages import Sized

from .gst_pipelines import WAYS, bit_rate
from .live_clip import HEIGHT, WIDTH, Clip
from .live_methods import GStreamer, Method, Nodes
from .live_score import LinkSample, Quality, Screen
from .quality import psnr
from .shaped_link import ShapedLink
from .shapers import Shaper
from .stack import Stack
from .started import Started
from .video_clips import RATE

START_TIMEOUT = 60.0
"""A method that has shown no image by then never will [s]."""

SAMPLE_PERIOD = 1.0
"""Time between samples of the link [s]."""

OURS: Dict[str, Tuple[str, ...]] = {'ours': (), 'layered': ('_camera/coding:=layered',),
                                    'h264': ('_camera/coding:=h264',)}
"""{method: robot_sender's arguments}"""


BEGUN = 2.0
"""All methods are watched from when the camera has run for this long, so that they are judged by the same scene: nodes
show their first image after up to 1.6 s, GStreamer at once [s]."""


class Cell(NamedTuple):
    """A link."""
    shaper: Shaper
    rates: Tuple[float, ...]
    """Rates of the link, one after the other [bit/s]."""
    loss: float
    """Packet-loss ratio of UDP datagrams to the operator, 0..1."""
    seconds: float
    """Duration of each rate [s]."""

    @property
    def name(self) -> str:
        """The name of the cell in tables and files."""
        return '%s, %s Mbit/s, %g %%' % (
            self.shaper.name, '-'.join('%g' % (rate / 1e6) for rate in self.rates), 100 * self.loss)


class Outcome(NamedTuple):
    """What was seen; times by time.time() [s]."""
    screen: Screen
    samples: Sequence[LinkSample]
    notes: Dict[int, Sized]
    """See Method.notes."""
    moments: List[float]
    """When it began, see `LiveRun.measure`, when each further rate was set, and the end."""


class LiveRun(Started):
    """A method's two sides and the link between them; a context manager.

    :param method: one of OURS or of WAYS
    :param folder: where images are recorded while it lasts
    :param log: file for the output of both sides; beside it, our nodes' trace is written
    :param masters: of our nodes: Stack for a shared one, or OwnMasters
    :param camera: see Nodes
    :param prepare: f(both sides of the link), called before anything is started there
    :raises LabError: where the link cannot be made
    :raises RuntimeError: where a side does not start
    """

    def __init__(self, cell: Cell, method: str, folder: pathlib.Path, log: pathlib.Path,
                 masters: Type[Stack] = Stack, camera: bool = True,
                 prepare: Callable[[TwoSides], Any] = lambda sides: None) -> None:
        super().__init__()
        self._cell, self._name = cell, method
        self._images = folder / 'screen'
        self._images.write_bytes(b'')
        self.callback(self._images.unlink)
        log.write_bytes(b'')
        self.link = ShapedLink(cell.shaper, cell.rates[0], cell.loss)
        made = masters if method in OURS else Stack
        self.stack = self.enter_context(made(log=log, sides=self.link.sides))
        with self.starting():
            prepare(self.link.sides)
            self.method = self._started(method, log, camera)

    def _started(self, method: str, log: pathlib.Path, camera: bool) -> Method:
        if method in OURS:
            return Nodes(self.stack, self._images, log.with_name('trace'), OURS[method], camera)
        way = WAYS[method]
        return GStreamer(self.stack, self._images, way, bit_rate(way, min(self._cell.rates), self._cell.loss))

    def first_image(self) -> float:
        """Wait for the first image on the screen; when it appeared by time.time() [s].

        :raises RuntimeError: where none comes
        """
        return await_image(self.method, '%s over %s' % (self._name, self._cell.name))

    def measure(self) -> Outcome:
        """Watch from the first image on, and from BEGUN at the earliest; at its end, nothing is sent any more.

        :raises RuntimeError: where there is none
        """
        begun = max(self.first_image(), scene_begins(self.method))
        moments, samples = [begun], []     # type: List[float], List[LinkSample]
        for rate in self._cell.rates:
            if samples:
                self.link.set_rate(rate)
                moments.append(time.time())
            samples += self.watch(rate, moments[-1] + self._cell.seconds)
        moments.append(time.time())
        shown = self.method.shown()
        self.stack.end_all()    # for the machine: what follows takes time
        screen = Screen(list(self.method.taken), shown, quality_of(self._images))
        return Outcome(screen, samples, self.method.notes(), moments)

    def watch(self, rate: float, until: float) -> List[LinkSample]:
        """Sample the link until a time.

        :param rate: [bit/s]
        """
        samples, last = [], self.link.sample()     # type: List[LinkSample], Any
        while time.time() < until:
            time.sleep(max(0.0, min(SAMPLE_PERIOD, until - time.time())))
            now = self.link.sample()
            carried = 8e-6 * (now.counted.sent - last.counted.sent) / (now.time - last.time)
            samples.append(LinkSample(now.time, rate / 1e6, carried, now.counted.dropped - last.counted.dropped,
                             self.method.status()))
            last = now
        return samples


def await_image(method: Method, name: str) -> float:
    """Wait for the first image on the screen; when it appeared by time.time() [s].

    :param name: of the method and its link, in words
    :raises RuntimeError: where none comes
    """
    deadline = time.monotonic() + START_TIMEOUT
    while not method.shown():
        if time.monotonic() > deadline:
            raise RuntimeError('%s shows no image: see nodes.log' % name)
        time.sleep(0.05)
    return method.shown()[0].arrival


def scene_begins(method: Method) -> float:
    """See BEGUN; by time.time() [s]."""
    return method.taken[0].stamp - method.taken[0].number / RATE + BEGUN


def quality_of(recorded: pathlib.Path) -> Quality:
    """The PSNR of the images in a file of live_recorder, of any beside any of the clip's."""
    clip = Clip()
    images: Array = np.fromfile(str(recorded), np.uint8)
    images = images[:len(images) // (HEIGHT * WIDTH) * HEIGHT * WIDTH].reshape(-1, HEIGHT, WIDTH)
    return remembered(lambda number, place: psnr(clip.image(number), images[place]))


def remembered(quality: Quality) -> Quality:
    """The same function, which computes each value once."""
    known: Dict[Tuple[int, int], float] = {}

    def found(number: int, place: int) -> float:
        if (number, place) not in known:
            known[number, place] = quality(number, place)
        return known[number, place]
    return found
