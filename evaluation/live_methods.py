# SPDX-License-Identifier: BSD-3-Clause
"""What sends the camera of `bench live`: the nodes as shipped, or GStreamer. Each runs on both sides of a stack."""
import json
import pathlib
import subprocess
import sys
import threading
from typing import Any, Callable, Dict, Iterable, List, Mapping, Sequence

from smokebot_udp.link_lab.lab import ADDRESSES
from smokebot_udp.monitoring.stages import Sized, read_sizes
from smokebot_udp.nodes.trace import VARIABLE

from . import TOP
from .gst_pipelines import Way
from .listener import Listener
from .live_score import Shown, Taken
from .stack import Stack

STREAM, SCREEN, LINK = 'camera', '/operator/camera/image_raw', '/robot_sender/link'
READY_TIMEOUT = 30.0
"""[s]"""


class Method:
    """One way of sending; ended with its stack.

    :param stack: of both sides
    :param images: file that the images of the screen are appended to
    """

    def __init__(self, stack: Stack, images: pathlib.Path) -> None:
        self.stack, self._images = stack, images
        self.taken: List[Taken] = []
        """By the camera until now."""

    def shown(self) -> List[Shown]:
        """What has appeared until now."""
        raise NotImplementedError

    def status(self) -> Dict[str, float]:
        """What the robot's side said of the link last; empty: nothing."""
        return {}

    def notes(self) -> Dict[int, Sized]:
        """{number of the camera's image: what decided its size}, where the robot's side says it."""
        return {}

    def _take(self, line: Any) -> None:
        self.taken.append(Taken(*line))

    def _collect(self, side: str, module: Iterable[str],
                 take: Callable[[Any], None]) -> 'subprocess.Popen[Any]':
        """Start a module on a side that writes lines of JSON."""
        process = self.stack.start(side, sys.executable, '-m', *module, cwd=str(TOP), stdout=subprocess.PIPE,
                                   universal_newlines=True)

        def read() -> None:
            for line in process.stdout:     # type: ignore[union-attr]
                take(json.loads(line))
        threading.Thread(target=read, daemon=True).start()
        return process


class Nodes(Method):
    """The package's nodes, with their default settings.

    :param trace: file that both sides' notes and marks are written to
    :param arguments: of robot_sender, beside them
    :param camera: whether there is a camera; without it the streams are idle
    """

    def __init__(self, stack: Stack, images: pathlib.Path, trace: pathlib.Path, arguments: Sequence[str] = (),
                 camera: bool = True) -> None:
        super().__init__(stack, images)
        self._trace = trace
        trace.write_bytes(b'')
        stack.variables[VARIABLE] = str(self._trace)
        self.sender = stack.start_sender(*arguments)
        """robot_sender."""
        stack.start_receiver()
        recorder = 'evaluation.live_recorder', str(images)
        self._robot, self._operator = (Listener(stack, side, recorder) for side in ('robot', 'operator'))
        self._robot.subscribe([[LINK, 'link', 'TCPROS']])
        self._operator.subscribe([[SCREEN, 'recorded grey', 'TCPROS']])
        if camera:
            self._collect('robot', ['evaluation.live_camera'], self._take)

    def shown(self) -> List[Shown]:
        numbers = {one.stamp: one.number for one in list(self.taken)}
        return [Shown(numbers.get(heard.stamp or 0.0), heard.arrival, heard.amount)
                for heard in list(self._operator.heard)]

    def status(self) -> Dict[str, float]:
        heard = self._robot.heard[-1:]
        return dict(heard[0].amount) if heard else {}

    def notes(self) -> Dict[int, Sized]:
        with open(str(self._trace), encoding='utf-8') as lines:
            return by_number(read_sizes(lines), {one.stamp: one.number for one in self.taken})


def by_number(sizes: Iterable[Sized], numbers: Mapping[float, int]) -> Dict[int, Sized]:
    """What decided the size of the camera's images, by their number.

    :param numbers: {stamp as Time.to_sec: number}
    """
    found = {numbers.get(one.stamp // 10 ** 9 + one.stamp % 10 ** 9 / 1e9): one for one in sizes
             if one.stream == STREAM}
    return {number: one for number, one in found.items() if number is not None}


class PeerMethod(Method):
    """What a user would send with instead. Of its two ends, the one that listens is started first."""

    def __init__(self, stack: Stack, images: pathlib.Path) -> None:
        super().__init__(stack, images)
        self._shown: List[Shown] = []
        self._ready = threading.Event()

    def _await_ready(self, name: str) -> None:
        """:raises RuntimeError: where the end that listens does not start"""
        if not self._ready.wait(READY_TIMEOUT):
            raise RuntimeError('%s does not start: see nodes.log' % name)

    def _once_ready(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """The same function of a line, for the end that listens: its `null` says that it does."""
        return lambda line: self._ready.set() if line is None else take(line)

    def _show(self, line: Any) -> None:
        self._shown.append(Shown(*line))

    def shown(self) -> List[Shown]:
        return list(self._shown)


class GStreamer(PeerMethod):
    """A pipeline on either side.

    :param bit_rate: of the encoder [kbit/s]
    """

    def __init__(self, stack: Stack, images: pathlib.Path, way: Way, bit_rate: int) -> None:
        super().__init__(stack, images)
        names: Dict[str, Any] = {**ADDRESSES, 'bit_rate': bit_rate}
        self._collect('operator', ['evaluation.gst_peer', 'receive', way.receiver.format(**names), str(images)],
                      self._once_ready(self._show))
        self._await_ready('the pipeline of %s' % way.title)
        self._collect('robot', ['evaluation.gst_peer', 'send', way.sender.format(**names)], self._take)
