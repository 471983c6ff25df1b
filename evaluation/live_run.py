# SPDX-License-Identifier: BSD-3-Clause
"""One method on one link of `bench live`: starts both sides, watches the screen and the link, and ends them."""
import json
import pathlib
import subprocess
import sys
import threading
import time
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from smokebot_udp.arrays import Array
from smokebot_udp.link_lab.lab import ADDRESSES

from . import TOP
from .gst_pipelines import WAYS, bit_rate
from .listener import Listener
from .live_clip import HEIGHT, WIDTH, Clip
from .live_score import Screen, Shown, Taken, Told
from .quality import psnr
from .shaped_link import ShapedLink
from .shapers import Shaper
from .stack import Stack

CAMERA, SCREEN, LINK = 'camera/image_raw', 'operator/camera/image_raw', 'robot_sender/link'
START_TIMEOUT = 60.0
"""A method that has shown no image by then never will [s]."""

SAMPLE_PERIOD = 1.0
"""Of the link [s]."""

OURS: Dict[str, Tuple[str, ...]] = {'ours': (), 'layered': ('_camera/coding:=layered',),
                                    'h264': ('_camera/coding:=h264',)}
"""{method: robot_sender's arguments}"""


class Cell(NamedTuple):
    """A link."""
    shaper: Shaper
    rates: Tuple[float, ...]
    """One after the other [bit/s]."""
    loss: float
    """0..1"""
    seconds: float
    """Of each rate, after the first image."""

    @property
    def name(self) -> str:
        """For tables and files."""
        return '%s %s Mbit/s %g %%' % (
            self.shaper.name, '-'.join('%g' % (rate / 1e6) for rate in self.rates), 100 * self.loss)


class Outcome(NamedTuple):
    """What was seen; times by time.time() [s]."""
    screen: Screen
    told: List[Told]
    begun: float
    """When the first image appeared."""
    steps: List[float]
    """When each rate was set; the first one before anything started."""
    ended: float


class Lines:
    """Collects the lines of JSON that a process writes."""

    def __init__(self, process: Any, take: Callable[[Any], None]) -> None:
        def read() -> None:
            for line in process.stdout:
                take(json.loads(line))
        threading.Thread(target=read, daemon=True).start()


class LiveRun:
    """Both sides of a method on a link; a context manager.

    :param method: one of OURS or of WAYS
    :param folder: where images are recorded while it lasts, and nodes.log is written
    :raises LabError: where the link cannot be made
    """

    def __init__(self, cell: Cell, method: str, folder: pathlib.Path, arguments: Sequence[str] = ()) -> None:
        self._cell, self._method, self._arguments = cell, method, arguments
        self._images, self.taken, self.shown = folder / 'screen', [], []    # type: pathlib.Path, List[Taken], List[Shown]
        self._images.write_bytes(b'')
        self.link = ShapedLink(cell.shaper, cell.rates[0], cell.loss)
        self.stack = Stack(log=folder / 'nodes.log', sides=self.link.sides)
        self._listeners: Dict[str, Listener] = {}
        try:
            self._start_ours() if method in OURS else self._start_gst()
        except BaseException:
            self.close()
            raise

    def _start_ours(self) -> None:
        self.stack.start_node('robot', 'robot_sender', *OURS[self._method], *self._arguments)
        self.stack.start_node('operator', 'operator_receiver')
        for side, topic, kind in (('operator', '/' + SCREEN, 'recorded grey'), ('robot', '/' + LINK, 'link')):
            listener = Listener(self.stack, side, ('evaluation.live_recorder', str(self._images)))
            listener.subscribe([[topic, kind, 'TCPROS']])
            self._listeners[side] = listener
        self._collect('robot', ['evaluation.live_camera'], self._take)

    def _start_gst(self) -> None:
        way = WAYS[self._method]
        names = {**ADDRESSES, 'bit_rate': bit_rate(way, min(self._cell.rates), self._cell.loss)}
        self._collect('operator', ['evaluation.gst_peer', 'receive', way.receiver.format(**names), str(self._images)],
                      lambda line: self.shown.append(Shown(*line)))
        self._collect('robot', ['evaluation.gst_peer', 'send', way.sender.format(**names)], self._take)

    def _take(self, line: Any) -> None:
        self.taken.append(Taken(*line))

    def _collect(self, side: str, module: Iterable[str], take: Callable[[Any], None]) -> None:
        Lines(self.stack.start(side, sys.executable, '-m', *module, cwd=str(TOP), stdout=subprocess.PIPE,
                               universal_newlines=True), take)

    def screen(self) -> Sequence[Shown]:
        """What has appeared until now."""
        if 'operator' not in self._listeners:
            return list(self.shown)
        numbers = {one.stamp: one.number for one in list(self.taken)}
        return [Shown(numbers.get(heard.stamp or 0.0), heard.arrival, heard.amount)
                for heard in list(self._listeners['operator'].heard)]

    def status(self) -> Dict[str, float]:
        """What the robot's side said of the link last."""
        heard = self._listeners['robot'].heard[-1:] if 'robot' in self._listeners else []
        return dict(heard[0].amount) if heard else {}

    def measure(self) -> Outcome:
        """Watch from the first image on.

        :raises RuntimeError: where there is none
        """
        deadline = time.monotonic() + START_TIMEOUT
        while not self.screen():
            if time.monotonic() > deadline:
                raise RuntimeError('%s shows no image over %s: see nodes.log' % (self._method, self._cell.name))
            time.sleep(0.05)
        begun, steps, told = self.screen()[0].arrival, [], []   # type: float, List[float], List[Told]
        for rate in self._cell.rates:
            if steps:
                self.link.set_rate(rate)
            steps.append(time.time())
            told += self._watch(rate, begun + self._cell.seconds * len(steps))
        ended = time.time()
        screen = Screen(list(self.taken), self.screen(), self._quality())
        return Outcome(screen, told, begun, steps, ended)

    def _watch(self, rate: float, until: float) -> List[Told]:
        """Sample the link until a time."""
        told, last = [], self.link.sample()
        while time.time() < until:
            time.sleep(min(SAMPLE_PERIOD, max(0.0, until - time.time())))
            now = self.link.sample()
            told.append(Told(now.time, rate / 1e6, 8e-6 * (now.count.sent - last.count.sent) / (now.time - last.time),
                             now.count.dropped - last.count.dropped, self.status()))
            last = now
        return told

    def _quality(self) -> Callable[[int, int], float]:
        clip, cache = Clip(), {}    # type: Clip, Dict[Tuple[int, int], float]
        images: Array = np.fromfile(str(self._images), np.uint8).reshape(-1, HEIGHT, WIDTH)

        def quality(number: int, index: int) -> float:
            if (number, index) not in cache:
                cache[number, index] = psnr(clip.image(number), images[index])
            return cache[number, index]
        return quality

    def close(self) -> None:
        """End both sides and the link, and delete the recorded images."""
        self.stack.close()
        self._images.unlink()

    def __enter__(self) -> 'LiveRun':
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


Progress = Optional[Callable[[str], None]]
