#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Golden files: what this package sends, and what operators show of it, on whatever machine (doc/wire_format.md).

    ./smokebot exec python3 tools/golden.py            # write test/golden anew: only where the wire format has changed
    ./smokebot exec python3 tools/golden.py --check    # exit with 1 where this machine would send anything else

Datagrams in test/golden/<stream>.bin were made once. Every release of Python, numpy, numba and PyAV must show the same
of them, and must compute what both sides need alike: test/unit/test_golden.py. What only the robot decides by floats,
such as how an image is cut into layers, may differ from one release to another: --check compares that, too.
"""
import argparse
import collections
import hashlib
import json
import math
import pathlib
import struct
import sys
import zlib
from typing import Any, Callable, Collection, Counter, Dict, Iterator, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np
from genpy import Time
from geometry_msgs.msg import Pose, TransformStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image, LaserScan, PointCloud2, PointField
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))
from evaluation.offline_link import MAX_DATAGRAM_SIZE, operator_side, part_of, work_off  # noqa: E402
from smokebot_udp import msg  # noqa: E402
from smokebot_udp.arrays import Array, Records  # noqa: E402
from smokebot_udp.mission.parameters import check  # noqa: E402
from smokebot_udp.mission.settings import Settings  # noqa: E402
from smokebot_udp.serialised import serialised  # noqa: E402
from smokebot_udp.streams import encoder_class  # noqa: E402
from smokebot_udp.streams.air import Air  # noqa: E402
from smokebot_udp.streams.outlook import Outlook  # noqa: E402
from smokebot_udp.udpros.datagram import OVERHEAD  # noqa: E402
from smokebot_udp.udpros.records import lengths_of, record_dtype  # noqa: E402

FOLDER = pathlib.Path(__file__).resolve().parent.parent / 'test' / 'golden'
EXPECTED = FOLDER / 'expected.json'

PERIOD = 0.1
"""Between two messages [s]."""
PAUSE = 10.0
"""After the last one [s]."""
OPERATOR = '/desk'
AIR = Air({0.0: 0.5, 0.2: 0.3, 0.5: 0.2}, None, True)

RECORD = struct.Struct('<HBBI')
"""Before each datagram's message: number of the source's message, part of the stream, whether it arrives, length."""

WIRE_MESSAGES = (
    'CameraInfoSegment', 'CapturePiece', 'CaptureRequest', 'ClockEcho', 'CloudChunk', 'Command', 'ControlRequest',
    'ControlStatus', 'FocusRequest', 'GridSegment', 'Held', 'ImageSegment', 'LayeredSegment', 'LinkReport', 'MapTile',
    'PathAnswer', 'PathProbe', 'RelaySegment', 'ReliableSegment', 'RobotStatus', 'ScanSegment', 'SettingsRequest',
    'SettingsState', 'VideoSlice')
"""All that cross the link."""


class Stream(NamedTuple):
    """A stream whose datagrams are golden."""
    kind: str
    """Its `type` in streams.yaml."""
    robot: Mapping[str, Any]
    operator: Mapping[str, Any]
    source: Callable[[int], Any]
    """f(number) -> a message"""
    messages: int
    loss: int = 0
    """One datagram of as many is lost; 0: none."""
    repeats: int = 0
    """After each message the encoder sends so many times what is still to be sent."""
    alike: bool = True
    """Whether each release sends the same bytes."""


# sources: integers only, so that they are the same everywhere

def noise(height: int, width: int, seed: int) -> Array:
    """(height, width) int64 from 0 to 15."""
    rows, columns = np.mgrid[:height, :width]
    mixed = (rows * 7919 + columns * 104729 + seed * 1299709) * 2654435761 & 0xffffffff
    return np.asarray((mixed ^ mixed >> 15) >> 7 & 15)


def scene(number: int, height: int = 96, width: int = 120, offset: int = 0, grain: int = 8) -> Array:
    """(height, width) int64 from 0 to 255: slopes and edges, which move by two pixels each image, and noise."""
    rows, columns = np.mgrid[:height, :width]
    columns = columns + 2 * number + offset
    slopes = abs((3 * columns + 2 * rows) % 256 - 128) + abs((rows * rows // 40 + columns) % 128 - 64) // 2
    return np.asarray(np.clip(slopes + 60 * (columns // 40 % 2) + noise(height, width, number) // grain, 0, 255))


def header(number: int, frame: str) -> Header:
    """The header of a message of a number."""
    return Header(stamp=Time(100 + number // 10, number % 10 * 10 ** 8), frame_id=frame)


def image(number: int, pixels: Array, encoding: str) -> Any:
    """A sensor_msgs/Image."""
    return Image(header=header(number, 'camera'), height=pixels.shape[0], width=pixels.shape[1], encoding=encoding,
                 step=pixels.nbytes // pixels.shape[0], data=pixels.tobytes())


def grey(number: int) -> Any:
    """It moves at first, then stands."""
    return image(number, scene(min(number, 5)).astype(np.uint8), 'mono8')


def thermal(number: int) -> Any:
    """Of 16 bits, in an odd size."""
    counts = 7000 + 9 * scene(min(number, 4), 81, 107, grain=16) + noise(81, 107, number) // 3
    return image(number, counts.astype('<u2'), 'mono16')


def colour(number: int) -> Any:
    """The colours move apart."""
    planes = [scene(number, 64, 90, 31 * plane) for plane in range(3)]
    return image(number, np.ascontiguousarray(np.dstack(planes), np.uint8), 'bgr8')


def depth(number: int) -> Any:
    """In whole millimetres, with a NaN and infinities."""
    metres = (scene(number, 50, 66) * 16).astype('<f4') / np.float32(1024)
    metres[10:20, 5:30], metres[30:33, 40:], metres[40:, :9] = np.nan, np.inf, -np.inf
    return image(number, metres, '32FC1')


def mosaic(number: int) -> Any:
    """A Bayer mosaic with an odd number of cells in a row."""
    return image(number, scene(number, 36, 54).astype(np.uint8), 'bayer_rggb8')


def occupancy(number: int) -> Any:
    """A map that grows, and whose origin moves by whole cells; walls, free and unknown cells, and graded ones."""
    height, width = 60 + 8 * number, 90
    rows, columns = np.mgrid[:height, :width] - np.array([4 * number, 0]).reshape(2, 1, 1)
    cells = np.where((rows % 20 == 3) | (columns % 24 == 7), 100, 0)
    cells[(rows * 3 + columns * 2) % 97 < 20 - 3 * number] = -1
    graded = (abs(rows - 30) < 9) & (abs(columns - 40) < 12)
    cells = np.where(graded, 30 + (rows + columns) % 40, cells).astype(np.int8)
    info = MapMetaData(resolution=0.05000000074505806, width=width, height=height, origin=Pose())
    info.origin.position.y, info.origin.orientation.w = -0.2 * number, 1.0
    return OccupancyGrid(header=header(number, 'map'), info=info, data=cells.ravel().tolist())


def points(number: int) -> Any:
    """A wall, a floor and clutter in steps of 1/64 m, with an intensity."""
    counted = np.arange(2400)
    x, y = counted * 37 % 640, counted * 53 % 480
    z = np.where(counted % 3 == 0, 0, np.where(counted % 3 == 1, counted * 11 % 160, counted * counted % 97 + number))
    cells = np.column_stack([x - 320, y - 240 + number, z]).astype('<f4') / np.float32(64)
    return cloud(number, np.column_stack([cells, counted * 29 % 200]).astype('<f4'), ('x', 'y', 'z', 'intensity'))


def cloud(number: int, values: Array, names: Sequence[str]) -> Any:
    """A sensor_msgs/PointCloud2 of float32."""
    fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(names)]
    return PointCloud2(header=header(number, 'lidar'), height=1, width=len(values), fields=fields, is_dense=True,
                       point_step=4 * len(names), row_step=values.nbytes, data=values.tobytes())


def ringed(number: int) -> Any:
    """Few points with a further field."""
    values = np.frombuffer(points(number).data, '<f4').reshape(-1, 4)[:300].copy()
    return cloud(number, values, ('x', 'y', 'z', 'ring'))


def scan(number: int) -> Any:
    """In millimetres, with NaN and infinities; the second one not in millimetres."""
    ranges = (1000 + np.arange(720) * 17 % 9000).astype(np.float32) / np.float32(1024 if number % 2 else 1000)
    ranges[5:9], ranges[100], ranges[200] = np.inf, -np.inf, np.nan
    return LaserScan(header=header(number, 'laser'), angle_min=-3.0, angle_max=3.0, angle_increment=0.008,
                     range_min=0.25, range_max=30.0, ranges=ranges.tolist(),
                     intensities=(np.arange(720) % 256).astype(np.float32).tolist())


def log(number: int) -> Any:
    """A message that is compressed and takes several datagrams."""
    text = ' '.join('%d' % (value * value * 7919 % 10007) for value in range(900))
    return Log(header=header(number, 'base'), level=2, name='/node', msg=text)


def transforms(number: int) -> Any:
    """Short ones."""
    found = []
    for child in ('base', 'laser'):
        transform = TransformStamped(header=header(number, 'odom'), child_frame_id=child)
        transform.transform.rotation.w, transform.transform.translation.x = 1.0, number / 8
        found.append(transform)
    return TFMessage(found)


LAYERED = {'coding': 'layered', 'max_bytes': 3000}
STREAMS: Mapping[str, Stream] = {
    'layered_grey': Stream('image', LAYERED, {}, grey, 9, 5, alike=False),
    'layered_16_bits': Stream('image', {**LAYERED, 'max_bytes': 4000}, {}, thermal, 9, 4, alike=False),
    'layered_exact': Stream('image', {'coding': 'layered'}, {}, thermal, 3, alike=False),
    'layered_colour': Stream('image', LAYERED, {}, colour, 6, 6, alike=False),
    'layered_depth': Stream('image', {**LAYERED, 'depth_unit': 1 / 1024}, {}, depth, 4, 5, alike=False),
    'interleaved_mosaic': Stream('image', {'coding': 'interleaved'}, {}, mosaic, 2),
    'video': Stream('image', {'coding': 'h264', 'max_bytes': 2500}, {}, lambda number: image(
        number, scene(number).astype(np.uint8), 'mono8'), 9, 9, alike=False),
    'map_tiles': Stream('grid', {'coding': 'tiles', 'robot_frame': ''}, {}, occupancy, 4, 4, 25),
    'map_interleaved': Stream('grid', {'coding': 'interleaved'}, {}, occupancy, 2),
    'cloud_sorted': Stream('cloud', {'encoding': 'sorted', 'leaf_size': 0.0, 'intensity': True}, {}, points, 2, 5),
    'cloud_packed': Stream('cloud', {'encoding': 'packed', 'leaf_size': 0.0, 'intensity': True, 'fields': 'ring'}, {},
                           ringed, 1),
    'cloud_float32': Stream('cloud', {'encoding': 'float32', 'leaf_size': 0.0}, {}, ringed, 1, 3),
    'scan': Stream('scan', {}, {}, scan, 2),
    'relay_compressed': Stream('relay', {'message_type': 'rosgraph_msgs/Log'}, {'message_type': 'rosgraph_msgs/Log'},
                               log, 2, alike=False),       # zlib's, of which there are several
    'relay_transforms': Stream('relay', {'message_type': 'tf2_msgs/TFMessage'},
                               {'message_type': 'tf2_msgs/TFMessage'}, transforms, 2),
}


class Datagram(NamedTuple):
    """One datagram's message."""
    number: int
    """Of the source's message."""
    part: int
    """Of the stream, in the order of their names."""
    arrives: bool
    data: bytes


def pack(datagrams: Sequence[Datagram]) -> bytes:
    """A golden file."""
    return b''.join(RECORD.pack(number, part, arrives, len(data)) + data for number, part, arrives, data in datagrams)


def unpack(data: bytes) -> List[Datagram]:
    """The inverse of pack."""
    found, at = [], 0
    while at < len(data):
        number, part, arrives, length = RECORD.unpack_from(data, at)
        at += RECORD.size + length
        found.append(Datagram(number, part, bool(arrives), data[at - length:at]))
    return found


class Operator:
    """What an operator shows of a stream."""

    def __init__(self, stream: Stream) -> None:
        self.assembler, self._settings = operator_side(stream.kind, **stream.operator)
        self.parts = sorted(self.assembler.SEGMENTS)
        self.shown: List[Tuple[int, Any]] = []
        """(number of the newest message that was sent then, message)"""

    def receive(self, datagrams: Sequence[Datagram], now: float) -> None:
        """Take the datagrams of a time [s]."""
        for one in datagrams:
            part = self.parts[one.part]
            class_ = self.assembler.SEGMENTS[part]
            if self.assembler.FORWARDS:
                message = self.assembler.join(class_().deserialize(one.data))
                forwarded = None if message is None else self.assembler.forward(message)
                self.shown += [] if forwarded is None else [(one.number, forwarded.message)]
                continue
            self.assembler.receive(_records(class_, one.data), np.ones(1, bool), now, part)
            work_off(self.assembler)
            self.poll(one.number, now)

    def poll(self, number: int, now: float) -> None:
        """Show what is finished."""
        if self.assembler.FORWARDS:
            return
        finished = self.assembler.poll(now)
        while finished is not None:
            assembled = self.assembler.assemble(finished, self._settings, False, now)
            if assembled is not None:
                self.assembler.settle(finished, assembled, self._settings, now)
                self.shown.append((number, assembled.message))
            finished = self.assembler.poll(now)

    @property
    def dropped(self) -> Counter[str]:
        """{reason: segments}"""
        return collections.Counter({reason: count for reason, count in self.assembler.dropped.items() if count})


def _records(message_class: Any, data: bytes) -> Records:
    records: Any = np.frombuffer(data, record_dtype(message_class, lengths_of(message_class, data)))
    return records


class Robot:
    """Sends a stream."""

    def __init__(self, stream: Stream, operators: Collection[str] = (OPERATOR,)) -> None:
        class_: Any = encoder_class(stream.kind)
        self._stream, self.now = stream, 0.0
        self._settings = Settings(check({'robot_topic': 'unused', **stream.robot}, class_.PARAMETERS))
        sessions = iter(range(1000, 2000))
        known: Dict[str, Any] = {}
        if stream.kind in ('image', 'grid'):
            known = {'clock': lambda: self.now, 'session': lambda: next(sessions)}
        self.encoder = class_(self._settings.requested, **known)
        self.encoder.outlook = Outlook(AIR, 1e6)
        self.encoder.operators = lambda part: operators
        self._seqs: Counter[Any] = collections.Counter()

    def frames(self, number: int, now: float) -> List[Any]:
        """What carries a message of the source."""
        self.now = now
        message = self.encoder.merge(None, self.encoder.derive(self._stream.source(number), self._settings))
        return self._numbered(self.encoder.encode(message, self._settings, MAX_DATAGRAM_SIZE))

    def repeat(self, now: float) -> List[Any]:
        """What is sent beside messages."""
        self.now = now
        return self._numbered(self.encoder.repeat(self._settings, MAX_DATAGRAM_SIZE))

    def _numbered(self, frames: Sequence[Any]) -> List[Any]:
        for frame in frames:
            for records in frame.records:
                records['header']['seq'] = self._seqs[frame.message_class]
                self._seqs[frame.message_class] += 1
        return list(frames)


def _moments(stream: Stream) -> Iterator[Tuple[int, int, float]]:
    """Number of the message, 0 or how many times something was repeated since it, and when [s]."""
    for number in range(stream.messages):
        for repeat in range(stream.repeats + 1):
            yield number, repeat, PERIOD * (number * (stream.repeats + 1) + repeat)


def send(stream: Stream) -> List[Datagram]:
    """All datagrams of a stream, sent to an operator who reports what it holds."""
    robot, operator = Robot(stream), Operator(stream)
    sent: List[Datagram] = []
    for number, repeat, now in _moments(stream):
        frames = robot.repeat(now) if repeat else robot.frames(number, now)
        begin = len(sent)
        for frame in frames:
            part = operator.parts.index(part_of(operator.assembler, frame))
            for row in frame.rows:
                arrives = not stream.loss or len(sent) % stream.loss != stream.loss - 1
                sent.append(Datagram(number, part, arrives, row[OVERHEAD:].tobytes()))
        _arrive(operator, sent[begin:], number, now)
        holding = operator.assembler.holding()
        if holding is not None:
            robot.encoder.held(OPERATOR, holding)
    return sent


def _arrive(operator: Operator, datagrams: Sequence[Datagram], number: int, now: float) -> None:
    operator.receive([one for one in datagrams if one.arrives], now)
    operator.poll(number, now + 0.9 * PERIOD)


def shown(stream: Stream, datagrams: Sequence[Datagram]) -> Operator:
    """An operator who received the datagrams of a stream, message by message."""
    operator = Operator(stream)
    for number in range(stream.messages):
        _arrive(operator, [one for one in datagrams if one.number == number], number,
                PERIOD * number * (stream.repeats + 1))
    operator.poll(stream.messages - 1, PERIOD * stream.messages * (stream.repeats + 1) + PAUSE)
    return operator


def digest(data: Any) -> str:
    """The first digits of the SHA-256 of bytes, or of an array's little-endian ones and its shape."""
    if isinstance(data, np.ndarray):
        data = repr(data.shape).encode() + np.ascontiguousarray(data, data.dtype.newbyteorder('<')).tobytes()
    return hashlib.sha256(data).hexdigest()[:16]


def read(name: str) -> List[Datagram]:
    """The golden datagrams of a stream."""
    return unpack((FOLDER / (name + '.bin')).read_bytes())


def seen(operator: Operator) -> List[str]:
    """Each message that is shown: when, and its checksum."""
    return ['%d: %08x' % (number, zlib.crc32(serialised(message))) for number, message in operator.shown]


def source_checksum(stream: Stream) -> str:
    """Of all messages of a stream's source."""
    return '%08x' % zlib.crc32(b''.join(serialised(stream.source(number)) for number in range(stream.messages)))


# what both sides compute, or one side for the other, without a stream around it: see doc/wire_format.md

def _coefficient_tables() -> Iterator[Array]:
    from smokebot_udp.codecs.layered import coefficients, contexts, layout, warp, wavelet
    for height, width, channels in ((1, 1, 1), (17, 5, 1), (96, 120, 1), (480, 640, 1), (480, 640, 3), (1080, 1920, 1)):
        for lossless in (False, True):
            plan = layout.layout_of(height, width, channels, lossless)
            yield from (np.asarray(value) for value in (plan.bands, plan.firsts, plan.blocks, plan.steps))
            yield coefficients.guesses_of(lossless)
    yield contexts.initial_odds(4)
    yield from (warp.SHARP, warp.SMOOTH)
    yield from (np.asarray(value) for name, value in sorted(vars(wavelet).items())
                if name.isupper() and isinstance(value, np.ndarray))


def _layered(lossless: bool) -> Iterator[Any]:
    """Streams of fixed lengths, what some of their beginnings show, and likewise of images that are predicted."""
    from smokebot_udp.codecs.layered import image as codec
    from smokebot_udp.codecs.layered import motion
    classes = (noise(61, 83, 1) > 14).astype(np.uint8)
    for pixels in (scene(0, 61, 83).astype(np.uint8), (scene(0, 61, 83) * 200).astype(np.uint16),
                   np.ascontiguousarray(np.dstack([scene(0, 61, 83, 31 * i) for i in range(3)]), np.uint8)):
        channels = 1 if pixels.ndim == 2 else 3
        shape = (61, 83, channels, pixels.itemsize)
        reference = None
        for moved in (0, 2, 2):
            of_classes = classes if channels == 1 and moved == 0 else None
            stream = codec.encode(np.ascontiguousarray(np.roll(pixels, moved, axis=1)), lossless, 900, of_classes,
                                  reference)
            decoded = codec.decode(stream.data, *shape, reference)
            half = codec.read(stream.data[:500], *shape, reference)
            assert decoded is not None and half is not None
            yield from (stream.data, decoded.pixels, half.prefixes.all_pixels())
            kept = half.prefixes.pixels(450)
            assert kept is not None
            yield kept
            nodes = np.zeros((2, 3, 4), np.int16) + np.arange(-11, 13, dtype=np.int16).reshape(2, 3, 4)
            reference = motion.compensate(decoded.pixels, motion.Motion(nodes, bool(moved)))
            yield reference


def _pieces() -> Iterator[Any]:
    from smokebot_udp.codecs.layered.pieces import Layer, Plan, Restorer, protect
    data = noise(80, 90, 2).astype(np.uint8).tobytes()
    for plan in (Plan(12, [Layer(2, 40), Layer(7, 100), Layer(12, 60)]), Plan(256, [Layer(3, 20), Layer(100, 30)]),
                 Plan(480, [Layer(3, 20), Layer(150, 9)])):
        pieces = protect(data, plan)
        yield pieces
        restorer = Restorer(plan.count, plan.layers)
        last = np.arange(plan.count)[plan.count // 5:]
        restorer.add(last, pieces[last])
        yield restorer.restored()


def _tiles() -> Iterator[Any]:
    from smokebot_udp.codecs.tiles import coder
    from smokebot_udp.codecs.tiles.lattice import Lattice
    from smokebot_udp.codecs.tiles.overview import overview
    for number in range(3):
        message = occupancy(number)
        cells = np.array(message.data, np.int8).reshape(message.info.height, message.info.width)
        coded = coder.encode(cells, 1 << 16)
        assert coded is not None
        yield coded
        yield coder.decode(np.frombuffer(coded, np.uint8), *cells.shape)
        corner = Lattice.of('map', message.info).corner
        yield repr(tuple(map(int, corner))).encode()
        shift, pieces = overview(cells, corner, 200, 2)
        yield from [bytes([shift])] + [piece.data for piece in pieces]


def _sorted_points() -> Iterator[Any]:
    from smokebot_udp.codecs.wire import cloud, sorted_cloud, z_order
    from smokebot_udp.codecs.wire.prefix_code import best_code
    values = np.frombuffer(points(0).data, '<f4').reshape(-1, 4)
    xyz, intensity = np.ascontiguousarray(values[:, :3]), np.ascontiguousarray(values[:, 3])
    layout = cloud.packed(xyz, 0.0125, intensity)
    keys = z_order.keys_of(layout.offsets(xyz), layout.bits)
    yield keys
    yield z_order.offsets_of(keys, layout.bits)
    yield sorted_cloud.hashes_of(keys, 6)
    yield from (cloud.sending_order(count) for count in (1, 2, 7, 100))
    yield from (np.asarray(best_code(np.array(counts)).lengths) for counts in ([5], [1, 1], [900, 500, 3, 3, 1, 0, 70]))
    yield layout.points(layout.offsets(xyz))
    yield layout.intensities(layout.levels(intensity))


def _orders() -> Iterator[Any]:
    from smokebot_udp.codecs.wire import interleave, scan
    yield from (interleave.table(d) for d in (1, 2, 3))
    ranges = np.array([0.0, 1.234, 65.532, math.inf, -math.inf, math.nan], np.float32)
    yield scan.write_ranges(ranges)
    yield scan.read_ranges(scan.write_ranges(ranges))
    yield scan.write_ranges(ranges + np.float32(1e-4))


def _identities() -> Iterator[Any]:
    from smokebot_udp.checksum import typed_checksum
    from smokebot_udp.link.tables import Topic
    from smokebot_udp.packed import unpack as unpacked
    from smokebot_udp.reliable.calls import type_checksum
    yield str(typed_checksum('0123456789abcdef', b'data')).encode()
    yield str(type_checksum('std_srvs/Empty', '0' * 32)).encode()
    yield str(Topic('/smokebot_udp/camera/layers', 'smokebot_udp/LayeredSegment', '0' * 32).id).encode()
    yield unpacked(b'\1' + zlib.compress(b'message' * 99, 1), 1 << 16)


COMPUTED: Mapping[str, Callable[[], Iterator[Any]]] = {
    'layered: tables': _coefficient_tables,
    'layered: 9/7': lambda: _layered(False),
    'layered: 5/3': lambda: _layered(True),
    'layered: pieces': _pieces,
    'tiles': _tiles,
    'sorted points': _sorted_points,
    'orders of pixels and ranges': _orders,
    'checksums and connection ids': _identities,
}
"""{name: f() -> bytes and arrays}"""


def computed(name: str) -> List[str]:
    """What this machine computes of COMPUTED."""
    return [digest(value) for value in COMPUTED[name]()]


def messages() -> Dict[str, str]:
    """{message that crosses the link: its md5sum here}"""
    return {name: getattr(msg, name)._md5sum for name in WIRE_MESSAGES}


def made() -> Tuple[Dict[str, Any], Dict[str, List[Datagram]]]:
    """expected.json, and the datagrams of each stream, as this machine makes them."""
    sent = {name: send(stream) for name, stream in STREAMS.items()}
    return {'messages': messages(), 'computed': {name: computed(name) for name in COMPUTED},
            'sources': {name: source_checksum(stream) for name, stream in STREAMS.items()},
            'shown': {name: seen(shown(stream, sent[name])) for name, stream in STREAMS.items()}}, sent


def differences() -> List[str]:
    """What this machine would make differently, in words."""
    expected, (here, sent) = json.loads(EXPECTED.read_text()), made()
    found = ['%s of %s' % (kind, name) for kind in ('messages', 'computed', 'sources') for name in here[kind]
             if expected[kind].get(name) != here[kind][name]]
    found += ['what is shown of the golden datagrams of %s' % name for name, stream in STREAMS.items()
              if seen(shown(stream, read(name))) != expected['shown'][name]]
    return found + ['datagrams of %s%s' % (name, '' if STREAMS[name].alike else ', which may differ between releases')
                    for name in STREAMS if sent[name] != read(name)]


def write() -> int:
    """Write the files; their size [byte]."""
    FOLDER.mkdir(exist_ok=True)
    expected, sent = made()
    EXPECTED.write_text(json.dumps(expected, indent=1, sort_keys=True) + '\n')
    for name, datagrams in sent.items():
        (FOLDER / (name + '.bin')).write_bytes(pack(datagrams))
    return sum(path.stat().st_size for path in FOLDER.iterdir())


def main(arguments: Sequence[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description='Golden files of the wire format.')
    parser.add_argument('--check', action='store_true', help='compare what this machine makes; write nothing')
    if not parser.parse_args(arguments).check:
        print('%d bytes in %s' % (write(), FOLDER))
        return 0
    found = differences()
    print('\n'.join(found) if found else 'this machine sends and shows the golden files')
    return 1 if found else 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
