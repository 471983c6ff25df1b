# SPDX-License-Identifier: BSD-3-Clause
"""Sorted clouds: the encoder's chunks to their points."""
import tracemalloc
from typing import Any, Dict, List, Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.wire import sorted_cloud
from smokebot_udp.codecs.wire.cloud import MAX_POINTS, PointFormat, packed, plain
from smokebot_udp.codecs.wire.sorted_cloud import MANY, dealing_order, encode
from smokebot_udp.codecs.wire.sorted_parts import SortedParts
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.world import building

pytestmark = pytest.mark.filterwarnings('error')
BOUND, ROOM = 0.0125, 1390
F32 = np.float32


def parts_of(points: Any, layout: PointFormat, coded: Any, came: Any = None) -> SortedParts:
    parts = SortedParts(len(points), len(coded.data), layout, coded.codes)
    indexes = np.arange(len(coded.data)) if came is None else np.flatnonzero(came)
    assert parts.add(indexes, coded.data[indexes]).all()
    return parts


def tables_in_python(codes: bytes) -> List[Dict[str, int]]:
    """{code word: class} of each sequence, as doc/wire_format.md has it."""
    tables, at = [], 0
    while at < len(codes):
        stop = at + 1 + -(-codes[at] // 2)
        lengths = [int(nibble, 16) for nibble in codes[at + 1:stop].hex()[:codes[at]]]
        table, word = {}, 0
        for length in range(1, 16):
            word <<= 1
            for class_ in (class_ for class_, own in enumerate(lengths) if own == length):
                table[format(word, '0%db' % length)] = class_
                word += 1
        tables.append(table)
        at = stop
    return tables


def sequences_in_python(data: bytes, codes: bytes, count: int) -> List[List[int]]:
    """The numbers of a chunk's sequences, likewise."""
    sequences, at = [], 1
    for table in tables_in_python(codes):
        size = int.from_bytes(data[at:at + 2], 'big')
        text = ''.join(format(byte, '08b') for byte in data[at + 2:])
        classes, begin = [], 0
        for _ in range(count):
            end = next(end for end in range(begin + 1, begin + 16) if text[begin:end] in table)
            classes.append(table[text[begin:end]])
            begin = end
        assert -(-begin // 8) == size
        begin, numbers = 8 * size, []
        for class_ in classes:
            numbers.append(int('1' + text[begin:begin + class_ - 1], 2) if class_ else 0)
            begin += max(class_ - 1, 0)
        sequences.append(numbers)
        at += 2 + -(-begin // 8)
    return sequences


def unzigzag(number: int) -> int:
    return -(number + 1) // 2 if number % 2 else number // 2


def read_in_python(data: bytes, codes: bytes, count: int, layout: PointFormat) -> List[Tuple[int, ...]]:
    """Offsets and intensity levels of a chunk, likewise."""
    low = min(6, sum(layout.bits))
    found, higher, level = [], 0, 0
    for gap, beside, *change in zip(*sequences_in_python(data, codes, count)):
        higher += gap
        spread = (higher * 0x9e3779b97f4a7c15 & (1 << 64) - 1) >> (64 - low)
        key, offsets = higher << low | (data[0] + unzigzag(beside) - spread) % (1 << low), [0, 0, 0]
        for bit in range(20):
            for axis in (axis for axis in range(3) if bit < layout.bits[axis]):
                offsets[axis] |= (key & 1) << bit
                key >>= 1
        level = (level + sum(map(unzigzag, change))) % 256
        found.append((*offsets, level))
    return found


def sorted_rows(values: Any) -> List[List[float]]:
    return sorted(np.asarray(values).tolist())


def test_a_cloud_by_hand() -> None:
    """Four points in steps of 0.5 m, in 3, 3 and 1 bits: keys x0 y0 z0 x1 y1 x2 y2."""
    points = np.array([(0, 0, 0), (0.5, 0, 0.5), (3.5, 3.5, 0.5), (3.5, 3.5, 0.5)], F32)
    layout = packed(points, 0.25)
    assert layout == PointFormat(False, 0.5, (0, 0, 0), (3, 3, 1))
    coded = encode(points, None, layout, ROOM)
    assert coded is not None and len(coded.data) == 1
    # keys 0, 5, 127, 127: of their bits above the lowest 6, gaps 0, 0, 1, 0: classes 0, 0, 1, 0, words of 1 bit each.
    # Hashes 0, 5, and twice 63 + 39 (the golden ratio's highest 6 bits) = 38 modulo 64; their mean is 20.25, so 20
    # and -20, -15, 18, 18: zigzag 39, 29, 36, 36; classes 6, 5, 6, 6
    assert coded.codes.hex() == '02' '11' '07' '00000110'
    assert coded.data.tobytes().hex() == (
        '14' '0001' '20' '0001' 'b0' + '%06x' % int('00111' '1101' '00100' '00100' '00000', 2))
    points_back, _ = parts_of(points, layout, coded).merge()
    assert sorted_rows(points_back) == sorted_rows(points)


CLOUDS = st.lists(st.tuples(*[st.floats(-200, 200, width=32)] * 3), min_size=1, max_size=60).map(
    lambda rows: np.array(rows, F32))


@settings(deadline=None)
@given(CLOUDS, st.sampled_from([0.004, 0.0125, 0.5, 1.0]), st.booleans(), st.sampled_from([60, 150, 1390]), st.data())
def test_whatever_chunks_arrive_hold_their_points(points, bound, with_intensity, room, data) -> None:
    intensity = points[:, 1].copy() if with_intensity else None
    layout = packed(points, bound, intensity)
    coded = encode(points, intensity, layout, room)
    if coded is None:
        assert room == 60 or sum(layout.bits) > sorted_cloud.MAX_KEY
        return
    assert coded.data.shape[1] + len(coded.codes) <= room and len(coded.data) <= len(points)
    came = np.array(data.draw(st.lists(st.booleans(), min_size=len(coded.data), max_size=len(coded.data))), bool)
    parts = parts_of(points, layout, coded, came)
    back, values = parts.merge()
    expected = []
    for index in np.flatnonzero(came).tolist():
        count = (len(points) - 1 - index) // len(came) + 1
        expected += read_in_python(coded.data[index].tobytes(), coded.codes, count, layout)
    offsets = np.array([row[:3] for row in expected], int).reshape(-1, 3)
    assert back.tolist() == layout.points(offsets).tolist()
    assert (values is None) == (intensity is None) and parts.broken == 0
    if values is not None:
        assert values.tolist() == layout.intensities(np.array([row[3] for row in expected], int)).tolist()
    if came.all():
        assert parts.complete
        quantised = layout.read(layout.write(points, intensity))
        both = (back, quantised[0]) if values is None else (
            np.column_stack([back, values]), np.column_stack(quantised))
        assert sorted_rows(both[0]) == sorted_rows(both[1])
        nearest = layout.points(layout.offsets(points))
        assert (np.abs(nearest.astype(float) - points) <= bound * (1 + 2e-7) + 3e-5).all()


@pytest.mark.parametrize('count', [1, 2, 700])
def test_copies_of_one_point(count) -> None:
    points = np.full((count, 3), 2.5, F32)
    layout = packed(points, BOUND, points[:, 0])
    coded = encode(points, points[:, 0], layout, ROOM)
    assert coded is not None and layout.bits == (0, 0, 0)
    back, values = parts_of(points, layout, coded).merge()
    assert back.tolist() == points.tolist() and values.tolist() == [2.5] * count


def test_what_cannot_be_sorted() -> None:
    wide = np.array([(0, 0, 0), (2 ** 20 - 1, 2 ** 20 - 1, 2 ** 17 - 1)], F32)
    assert packed(wide, 0.5).bits == (20, 20, 17) and encode(wide, None, packed(wide, 0.5), ROOM) is None
    narrower = np.minimum(wide, 2 ** 19 - 1)
    layout = packed(narrower, 0.5)
    coded = encode(narrower, None, layout, ROOM)
    assert sorted_rows(parts_of(narrower, layout, coded).merge()[0]) == sorted_rows(narrower)
    assert encode(wide, None, plain(False), ROOM) is None
    assert encode(narrower, None, layout, 10) is None


# dealing

def simulated() -> Any:
    scan = Lidar(building(1), 0.9, 1).scan((1.5, 7, 0.3), 1.0)
    return np.stack([scan[axis] for axis in 'xyz'], axis=1).astype(F32)


@settings(deadline=None)
@given(st.integers(1, 800), st.data())
def test_each_group_of_neighbours_is_dealt_evenly(count, data) -> None:
    chunks = data.draw(st.integers(1, count))
    hashes = np.random.RandomState(count).randint(0, 64, count)
    order = dealing_order(hashes, chunks)
    assert sorted(order.tolist()) == list(range(count))
    depth = 2 if chunks >= MANY else 1
    for start in range(0, count - depth * chunks + 1, depth * chunks):
        group = order[start:start + depth * chunks].reshape(depth, chunks)
        assert sorted(group.ravel()) == list(range(start, start + depth * chunks))
        # the chunks' shares of a group are in the order of their hashes
        mean = hashes[group].reshape(depth, chunks)
        assert (np.diff(mean.max(axis=0)) >= 0).all() and (np.diff(mean.min(axis=0)) >= 0).all()
    for chunk in range(chunks):
        assert (np.diff(order[chunk::chunks]) > 0).all()


def test_a_simulated_cloud_takes_few_bytes() -> None:
    points = simulated()
    layout = packed(points, BOUND)
    coded = encode(points, None, layout, ROOM)
    assert coded is not None and layout.size == 4
    assert coded.data.size <= 1.7 * len(points)
    # nearly full
    assert coded.data.shape[1] + len(coded.codes) >= 0.95 * ROOM


@pytest.mark.parametrize('count, least, chunks', [
    (1, 8, 1), (127, 8, 1), (128, 8, 2), (511, 8, 7), (512, 8, 8), (3000, 8, 8), (3000, 20, 20), (3000, 1, 4)])
def test_there_are_as_many_chunks_as_required(count, least, chunks) -> None:
    points = simulated()[::7][:count]
    coded = encode(points, None, packed(points, BOUND), ROOM, least)
    assert coded is not None and len(coded.data) == chunks


# what a hostile sender may send

def small(intensity: bool = True) -> Tuple[Any, PointFormat, Any]:
    random = np.random.RandomState(3)
    points = random.uniform(-5, 5, (200, 3)).astype(F32)
    values = random.uniform(0, 9, 200).astype(F32) if intensity else None
    layout = packed(points, BOUND, values)
    return points, layout, encode(points, values, layout, 300)


def test_broken_chunks_are_left_out_and_counted() -> None:
    points, layout, coded = small()
    whole = parts_of(points, layout, coded)
    expected = sorted_rows(whole.merge()[0])
    for size in (0, 1, 2, 3, 40, coded.data.shape[1] // 2):
        parts = parts_of(points, layout, coded)
        took = parts.add(np.array([1]), coded.data[1:2, :size])
        back = parts.merge()[0]
        if not took.all():
            assert sorted_rows(back) == expected and parts.broken == 0
            continue
        assert parts.broken == 1 and not parts.complete
        assert parts.have.tolist() == [index != 1 for index in range(len(coded.data))]
        rest = parts_of(points, layout, coded, np.arange(len(coded.data)) != 1)
        assert back.tolist() == rest.merge()[0].tolist()


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 2 ** 32 - 1), st.booleans(), st.integers(1, 12))
def test_forged_chunks_raise_nothing(seed, intensity, changes) -> None:
    points, layout, coded = small(intensity)
    random = np.random.RandomState(seed)
    data = coded.data.copy()
    for _ in range(changes):
        row = random.randint(len(data))
        data[row, random.choice([random.randint(data.shape[1]), random.randint(6)])] = random.randint(256)
    parts = SortedParts(len(points), len(data), layout, coded.codes)
    parts.add(np.arange(len(data)), data)
    back, values = parts.merge()
    assert np.isfinite(back).all() and len(back) <= len(points)
    assert parts.broken + int(parts.have.sum()) == len(data)
    low = np.array(layout.origin) * layout.step - 1e-3
    assert ((back >= low) & (back <= low + (1 << np.array(layout.bits)) * layout.step + 2e-3)).all()


@pytest.mark.parametrize('points, chunks, bits, step, codes', [
    (0, 0, (5, 5, 5), 0.1, '0211' '0211'), (0, 1, (5, 5, 5), 0.1, '0211' '0211'), (3, 4, (5, 5, 5), 0.1, '0211' '0211'),
    (MAX_POINTS + 1, 1, (5, 5, 5), 0.1, '0211' '0211'), (9, 1, (20, 20, 17), 0.1, '0211' '0211'),
    (9, 1, (5, 5, 5), 0.0, '0211' '0211'), (9, 1, (5, 5, 5), 0.1, '0211'), (9, 1, (5, 5, 5), 0.1, '00' '0211')])
def test_impossible_heads(points, chunks, bits, step, codes) -> None:
    with pytest.raises(ValueError):
        SortedParts(points, chunks, PointFormat(False, step, (0, 0, 0), bits), bytes.fromhex(codes))


def test_a_chunk_that_is_too_short_for_its_points_is_dropped() -> None:
    parts = SortedParts(MAX_POINTS, 1, PointFormat(False, 0.1, (0, 0, 0), (5, 5, 5)), bytes.fromhex('02110211'))
    assert parts.add(np.array([0]), np.zeros((1, 1400), np.uint8)).tolist() == [False]
    assert parts.add(np.array([1]), np.zeros((1, 1400), np.uint8)).tolist() == [False]
    assert parts.merge()[0].shape == (0, 3)


def test_a_chunk_that_is_longer_than_its_points_can_be_is_dropped() -> None:
    """100 points in 3 chunks: up to 34 in a chunk, 15 and 56 bits for each of two numbers."""
    parts = SortedParts(100, 3, PointFormat(False, 0.1, (0, 0, 0), (5, 5, 5)), bytes.fromhex('02110211'))
    most = 1 + 2 * (2 + 34 * 9)
    assert parts.add(np.array([2]), np.zeros((1, most), np.uint8)).tolist() == [True]
    assert parts.add(np.array([2]), np.zeros((1, most + 1), np.uint8)).tolist() == [False]


def test_a_long_chunk_does_not_make_the_others_take_memory() -> None:
    """One of 64 chunks is 60 kB long, as a message of many datagrams may be, and so are its code words."""
    layout = PointFormat(False, 0.1, (0, 0, 0), (5, 5, 5))
    parts = SortedParts(64 * 4000, 64, layout, bytes.fromhex('02110211'))
    long = np.zeros((1, 60000), np.uint8)
    long[0, 1:3] = 59000 >> 8, 59000 & 255
    assert parts.add(np.arange(63), np.zeros((63, 1400), np.uint8)).all() and parts.add(np.array([63]), long).all()
    tracemalloc.start()
    try:
        parts.merge()
        assert tracemalloc.get_traced_memory()[1] < 32e6
    finally:
        tracemalloc.stop()


def test_gaps_beyond_the_last_key_are_broken() -> None:
    """A gap of 1 where keys have 6 bits, all below the gap."""
    layout = PointFormat(False, 0.1, (0, 0, 0), (2, 2, 2))
    for first, good in ((0x00, True), (0x80, False)):
        parts = SortedParts(1, 1, layout, bytes.fromhex('0211' '0211'))
        data = np.array([[0, 0, 1, first, 0, 1, 0]], np.uint8)
        assert parts.add(np.array([0]), data).all()
        assert len(parts.merge()[0]) == int(good) and parts.broken == int(not good)
