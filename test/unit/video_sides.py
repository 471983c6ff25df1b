# SPDX-License-Identifier: BSD-3-Clause
"""Both sides of a video for tests: a scene that moves, the robot's encoder, and an operator who loses datagrams."""
import math
from typing import Any, Callable, Collection, Iterable, List, Mapping, Optional, Sequence

import needs_numba  # noqa: F401
import needs_pyav  # noqa: F401
import numpy as np
from genpy import Time
from sensor_msgs.msg import Image

from evaluation.linked_encoder import LinkedEncoder
from evaluation.offline_link import operator_side
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import VideoSlice
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.image.encoder import ImageEncoder
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import VIDEO
from smokebot_udp.udpros.datagram import OVERHEAD

DATAGRAM = 1472
PERIOD = 0.1
"""From an image to the next one [s]."""

NO_LOSS = Outlook(Air({0.001: 1.0}, None, True), 1e6)


def scene(number: int, encoding: str = 'mono8', height: int = 120, width: int = 160) -> Any:
    """A smooth image with an edge and some noise, which moves slowly: (height, width[, 3]) uint8."""
    rows, columns = np.mgrid[:height, :width]
    noise = np.random.RandomState(number)
    colours = 3 if encoding in ('bgr8', 'rgb8', '8UC3') else 1
    parts = [128 + 60 * np.sin((rows + number) / 17 + 2 * colour) * np.cos((columns + number) / 23)
             - 40 * ((columns + number) % width > 80) + noise.randn(height, width) for colour in range(colours)]
    return np.clip(np.dstack(parts) if colours > 1 else parts[0], 0, 255).astype(np.uint8)


def message(pixels: Any, number: int, encoding: str = 'mono8') -> Any:
    """The image of a number, one each PERIOD."""
    made = Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding, step=pixels.strides[0],
                 data=pixels.tobytes())
    made.header.stamp, made.header.frame_id = Time.from_sec(100 + PERIOD * number), 'lens'
    return made


def settings(granted: Optional[Mapping[str, Any]] = None, **changes: Any) -> Settings:
    return Settings(check({'robot_topic': '/in', 'coding': 'h264', **changes}, ImageEncoder.PARAMETERS), granted or {})


def psnr(first: Any, second: Any) -> float:
    """[dB]"""
    return 10 * math.log10(255 ** 2 / max(float(np.mean((first.astype(float) - second) ** 2)), 1e-9))


class Robot:
    """Encodes images; its sessions are 1, 2, ..."""

    def __init__(self, outlook: Outlook = NO_LOSS, operators: Collection[str] = ('desk',), **changes: Any) -> None:
        self.settings, self.now, self.sessions = settings(**changes), 0.0, 0
        self.operators = operators
        self.encoder = LinkedEncoder(
            ImageEncoder(self.settings.requested, clock=lambda: self.now, session=self._session), outlook=outlook,
            operators=lambda part: self.operators)

    def _session(self) -> int:
        self.sessions += 1
        return self.sessions

    def frames(self, pixels: Any, number: int, encoding: str = 'mono8') -> List[Any]:
        self.now = PERIOD * number
        return self.encoder.encode(message(pixels, number, encoding), self.settings, DATAGRAM)

    def records(self, pixels: Any, number: int, encoding: str = 'mono8') -> List[Any]:
        """(1,) structured array of each datagram, in sending order."""
        return [frame.records[row:row + 1] for frame in self.frames(pixels, number, encoding)
                for row in range(len(frame))]


class Operator:
    """Assembles images, and keeps what is published: {stamp: assembled}."""

    def __init__(self, **changes: Any) -> None:
        self.assembler, self.settings = operator_side('image', **changes)
        self.shown: List[Any] = []

    def receive(self, records: Iterable[Any], number: int, part: str = VIDEO) -> Optional[Any]:
        """What is published of the datagrams of an image when nothing follows them; None: nothing."""
        before, now = len(self.shown), PERIOD * number
        for of_layout in records:
            self.assembler.receive(of_layout, np.ones(len(of_layout), bool), now, part)
            self._poll(now)
        self._poll(now + self.settings['max_wait'])
        return self.shown[-1] if len(self.shown) > before else None

    def _poll(self, now: float) -> None:
        finished = self.assembler.poll(now)
        while finished is not None:
            assembled = self.assembler.assemble(finished, self.settings, False, now)
            if assembled is not None:
                self.assembler.settle(finished, assembled, self.settings, now)
                self.shown.append(assembled)
            finished = self.assembler.poll(now)

    @property
    def dropped(self) -> Mapping[str, int]:
        return {reason: count for reason, count in self.assembler.dropped.items() if count}


def slices(frames: Sequence[Any]) -> List[VideoSlice]:
    return [VideoSlice().deserialize(row[OVERHEAD:].tobytes()) for frame in frames for row in frame.rows]


def pixels_of(assembled: Any) -> Any:
    """(height, width[, 3]) uint8 of a published image."""
    image = assembled.message
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, -1).squeeze()


def run(robot: Robot, operator: Operator, numbers: Iterable[int], arrives: Callable[[int, int], bool],
        encoding: str = 'mono8') -> List[Optional[float]]:
    """The PSNR of each image that is shown, None of the others; reports come with the next image.

    :param arrives: f(number of an image, index of a datagram in sending order)
    """
    found: List[Optional[float]] = []
    for number in numbers:
        pixels = scene(number, encoding)
        records = robot.records(pixels, number, encoding)
        shown = operator.receive([one for index, one in enumerate(records) if arrives(number, index)], number)
        found.append(None if shown is None else psnr(pixels_of(shown), pixels))
        holding = operator.assembler.holding()
        if holding is not None:
            robot.encoder.held('desk', holding)
    return found
