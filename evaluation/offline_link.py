# SPDX-License-Identifier: BSD-3-Clause
"""Messages through the package's streams without a network: encoder, some of the datagrams, assembler."""
import math
from typing import Any, Dict, Iterable, List, Optional, Sequence, Tuple

import numpy as np
from genpy import Time
from sensor_msgs.msg import Image

from smokebot_udp.arrays import Array, BoolArray, Records
from smokebot_udp.codecs.concealment.fill import BEST
from smokebot_udp.codecs.wire.pixels import pixel_type
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.optional import found
from smokebot_udp.streams import assembler_class, encoder_class
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.assembler import Assembled, Assembler
from smokebot_udp.streams.held import Holding
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import MAIN_PART, size_on_air
from smokebot_udp.udpros.frame import Frame

from .linked_encoder import LinkedEncoder

MAX_DATAGRAM_SIZE = 1472
"""[byte of UDP payload]"""

FILL_TIME = 60.0
"""Large enough for the limit of the time to fill an image to change nothing here [s]."""

PAUSE = 60.0
"""Between two refresh cycles, so that the map is published after each [s]."""

FILLS = {BEST: 'kriging (this package)', 'nearest': 'nearest received pixel (the deliverable)'}
"""{method: its name in figures}"""


def operator_side(kind: str, **settings: Any) -> Tuple[Assembler[Any, Any], Settings]:
    """An assembler of this kind, and its settings: the defaults except for those given."""
    class_ = assembler_class(kind)
    checked = Settings(check({'operator_topic': 'unused', **settings}, class_.PARAMETERS))
    shared: Dict[str, Any] = {}
    if class_.DECODED and found('av'):
        from .plain_decoder import PlainDecoder  # imports PyAV
        shared = {'decoder': PlainDecoder()}
    return class_(checked, **shared), checked


def work_off(assembler: Any) -> None:
    """Have an assembler, or what has its method `work`, do all that takes time before a message can be finished."""
    work = assembler.work()
    while work is not None:
        work.do()
        work.done()
        work = assembler.work()


def assemble_all(assembler: Assembler[Any, Any], settings: Settings, batches: Iterable[Records], now: float = 0.0,
                 still: bool = False, part: str = MAIN_PART) -> List[Assembled]:
    """What an assembler makes of segments that are received at one moment, when nothing follows them.

    :param batches: (n,) structured arrays of segments, see udpros.records
    :param now: [s]
    :param still: whether the robot stands still
    :param part: of the stream, that of all segments
    """
    results: List[Assembled] = []

    def take(until: float) -> None:
        finished = assembler.poll(until)
        while finished is not None:
            assembled = assembler.assemble(finished, settings, still, now)
            if assembled is not None:
                assembler.settle(finished, assembled, settings, now)
                results.append(assembled)
            finished = assembler.poll(until)

    for records in batches:
        assembler.receive(records, np.ones(len(records), bool), now, part)
        work_off(assembler)
        take(now)
    take(math.inf)
    return results


class Sender:
    """The robot's side of a stream.

    :param kind: `type` in streams.yaml
    :param shared: what streams of this kind share, see its encoder
    :param settings: those that differ from their defaults
    """

    def __init__(self, kind: str, *shared: Any, **settings: Any) -> None:
        class_: Any = encoder_class(kind)
        self._settings = Settings(check({'robot_topic': 'unused', **settings}, class_.PARAMETERS))
        self._encoder = LinkedEncoder(class_(self._settings.requested, *shared))

    @property
    def warnings(self) -> Sequence[str]:
        """What is wrong with messages that were sent nevertheless."""
        warnings: Sequence[str] = self._encoder.warnings
        return warnings

    def expect(self, air: Air) -> None:
        """Plan for such a link from now on, whatever its rate."""
        self._encoder.see(outlook=Outlook(air))

    def serve(self, operator: str) -> None:
        """Send to an operator of this name from now on."""
        self._encoder.see(operators=lambda part: (operator,))

    def held(self, operator: str, holding: Holding) -> None:
        """Take an operator's report of what it holds."""
        self._encoder.held(operator, holding)

    def frames(self, message: Any) -> List[Frame]:
        """The frames that carry a message, in sending order."""
        derived = self._encoder.derive(message, self._settings)
        return self._encoder.encode(derived, self._settings, MAX_DATAGRAM_SIZE)


class Receiver:
    """The operator's side of a stream, for a robot that moves.

    :param kind: `type` in streams.yaml
    :param settings: those that differ from their defaults
    """

    def __init__(self, kind: str, **settings: Any) -> None:
        self._assembler, self._settings = operator_side(kind, **settings)
        self._message: Any = None
        self._now = 0.0

    def assemble(self, batches: Sequence[Records], part: str = MAIN_PART) -> Optional[Any]:
        """The message made of the segments that arrived of one, by itself; None: they are too few.

        :param batches: one array at least, see records_of
        :param part: of the stream
        """
        assembler = type(self._assembler)(self._settings)      # an older one may know a message with this stamp
        assembled = assemble_all(assembler, self._settings, batches, part=part)
        return assembled[-1].message if assembled else None

    def part_of(self, frame: Frame) -> str:
        """The part of the stream that carries a frame."""
        return part_of(self._assembler, frame)

    def update(self, batches: Sequence[Records]) -> Any:
        """The map after another refresh cycle, whose segments complete those of earlier ones.

        :param batches: one array at least, see records_of
        """
        self._now += PAUSE
        for assembled in assemble_all(self._assembler, self._settings, batches, self._now):
            self._message = assembled.message
        return self._message


def part_of(assembler: Assembler[Any, Any], frame: Frame) -> str:
    """The part of an assembler's stream that carries a frame."""
    return next(part for part, class_ in assembler.SEGMENTS.items() if class_ is frame.message_class)


def image_receiver(fill: str) -> Receiver:
    """A receiver of images that fills missing pixels by this method, and takes none from earlier images."""
    return Receiver('image', fill=fill, fill_time=FILL_TIME, integrate='never')


def datagram_count(frames: Sequence[Frame]) -> int:
    """The number of datagrams of some frames."""
    return sum(map(len, frames))


def wire_size(frames: Sequence[Frame]) -> int:
    """The size of some frames as IP packets [byte]."""
    return int(size_on_air(frames))


def records_of(frames: Sequence[Frame], arrived: BoolArray) -> List[Records]:
    """The segments that arrived: an array for each frame with any.

    :param arrived: (n,) bool for each datagram, in sending order
    """
    parts = np.split(arrived, np.cumsum([len(frame) for frame in frames])[:-1])
    return [frame.records[part] for frame, part in zip(frames, parts) if part.any()]


def received(receiver: Receiver, frames: Sequence[Frame], arrived: BoolArray) -> Optional[Any]:
    """The message made of the segments that arrived; None: none did, or too few of them.

    :param arrived: (n,) bool for each datagram, in sending order
    """
    if not arrived.any():
        return None
    return receiver.assemble(records_of(frames, arrived), receiver.part_of(frames[0]))


def image_message(image: Array, stamp: float = 0.0) -> Any:
    """A sensor_msgs/Image.

    :param image: (height, width) uint8 or uint16, or (height, width, 3) uint8: B, G, R
    :param stamp: [s]
    """
    encoding = 'bgr8' if image.ndim == 3 else 'mono8' if image.itemsize == 1 else 'mono16'
    message = Image(height=image.shape[0], width=image.shape[1], encoding=encoding, step=image.nbytes // image.shape[0],
                    data=image.tobytes())
    message.header.stamp, message.header.frame_id = Time.from_sec(stamp), 'camera'
    return message


def image_of(message: Any) -> Array:
    """The inverse of image_message."""
    item, channels = pixel_type(message.encoding)
    shape = (message.height, message.width) + (channels,) * (channels > 1)
    return np.frombuffer(message.data, item).reshape(shape)
