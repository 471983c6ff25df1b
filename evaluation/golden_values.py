# SPDX-License-Identifier: BSD-3-Clause
"""What robot and operator must compute alike, whatever their releases of Python and numpy (doc/wire_format.md): values
of tools/golden.py."""
import math
import zlib
from typing import Any, Callable, Iterator, Mapping

import numpy as np

from smokebot_udp.arrays import Array
from smokebot_udp.checksum import typed_checksum
from smokebot_udp.codecs.layered import blend, coefficients, contexts, layout, motion, shrinking, warp
from smokebot_udp.codecs.layered import image as codec
from smokebot_udp.codecs.layered.pieces import Layer, Plan, Restorer, protect
from smokebot_udp.codecs.tiles import coder
from smokebot_udp.codecs.tiles.lattice import Lattice
from smokebot_udp.codecs.tiles.overview import overview
from smokebot_udp.codecs.wire import cloud, coded_counts, interleave, scan, sorted_cloud, z_order
from smokebot_udp.codecs.wire.prefix_code import best_code
from smokebot_udp.link.tables import Topic
from smokebot_udp.packed import unpack
from smokebot_udp.reliable.calls import type_checksum
from smokebot_udp.streams.image.references import checksum_of

from .golden_streams import noise, occupancy, points, scene


def _coefficient_tables() -> Iterator[Array]:
    for height, width, channels in ((1, 1, 1), (17, 5, 1), (96, 120, 1), (480, 640, 1), (480, 640, 3), (1080, 1920, 1)):
        for lossless in (False, True):
            plan = layout.layout_of(height, width, channels, lossless)
            yield from (np.asarray(value) for value in (plan.firsts, plan.blocks, plan.steps))
            yield from (coefficients.guesses_of(lossless, predicted) for predicted in (False, True))
    yield contexts.initial_odds(4)
    yield from (warp.SHARP, warp.SMOOTH, shrinking.GAINS, shrinking.RATES)


def _layered(lossless: bool) -> Iterator[Any]:
    """Streams of fixed lengths, what some of their beginnings show, and likewise of images that are predicted."""
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
            nodes = (np.arange(2 * motion.NODES ** 2) * 37 % 101 - 40).reshape(motion.NODES, motion.NODES, 2)
            course = blend.Course(motion.Motion(nodes.astype(np.int16), bool(moved)), blend.Second(
                1, 2, 3 << 30, 5, motion.Motion((nodes[::-1] // 2).astype(np.int16), not moved)))
            coded = blend.to_bytes(course)
            reference = blend.predicted(blend.from_bytes(coded), decoded.pixels, kept)
            yield from (coded, reference, str(checksum_of(reference)).encode())


def _pieces() -> Iterator[Any]:
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
    yield from (interleave.table(d) for d in (1, 2, 3))
    ranges = np.array([0.0, 1.234, 65.532, math.inf, -math.inf, math.nan], np.float32)
    yield scan.write_ranges(ranges)
    yield scan.read_ranges(scan.write_ranges(ranges))
    yield scan.write_ranges(ranges + np.float32(1e-4))
    yield scan.in_steps(np.arange(-5, 70000, 7), 1000)
    yield scan.in_steps(np.arange(-5, 70000, 7), 333)
    row = np.arange(200) ** 2 % 1013, np.arange(200) % 50 // 47
    coded = coded_counts.encode(*row)
    yield coded
    yield from coded_counts.decode(np.frombuffer(coded, np.uint8), 200)


def _identities() -> Iterator[Any]:
    yield str(typed_checksum('0123456789abcdef', b'data')).encode()
    yield str(type_checksum('std_srvs/Empty', '0' * 32)).encode()
    yield str(Topic('/smokebot_udp/camera/layers', 'smokebot_udp/LayeredSegment', '0' * 32).id).encode()
    yield unpack(b'\1' + zlib.compress(b'message' * 99, 1), 1 << 16)


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
