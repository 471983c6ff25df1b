# SPDX-License-Identifier: BSD-3-Clause
"""A point cloud in chunks whose points are sorted and entropy-coded: 2 to 2.7 bytes a point instead of 4 to 5.

The points are sorted along a Z-order curve, and a chunk's are coded by the gaps between their places on it (keys). n
points of N places take log2(N / n) + 1.44 bits each if they are spread evenly, and fewer as they are clustered.

Points are dealt round-robin, in an order that saves further bits. Neighbours on the curve, one or two for each chunk,
form a group, and the points of a group are dealt in the order of a hash of their keys: each chunk gets those of about
the same hash. A key's lowest bits follow from its higher bits and its hash, so what is coded of them is how the hash
differs from the chunk's usual one. It says nothing about where a point is: any chunks thin the cloud as evenly as those
of neighbours that are dealt in turn.
"""
from typing import List, NamedTuple, Optional

import numpy as np

from ...arrays import Array, Float32Array, IntArray
from .bit_fields import bit_lengths, zigzag
from .cloud import MAX_CHUNKS, MAX_POINTS, Chunks, PointFormat
from .number_sequences import Numbers, numbers_of, write
from .z_order import keys_of

MAX_KEY = 56
"""Clouds whose offsets need more bits together are not sorted."""

HASHED = 6
"""Number of a key's lowest bits that are coded by their hash: with steps of a quarter of a voxel, places within one."""

GOLDEN = np.uint64(0x9e3779b97f4a7c15)
"""2^64 divided by the golden ratio (Knuth 1973, section 6.4): its multiples spread any higher bits evenly."""

MANY = 64
"""Clouds in at least this many chunks are dealt in groups of two points for each chunk, else of one. The larger the
group, the fewer bits, and the less even are few chunks."""

FIRST_GUESS = 2.5
"""First estimate of the size of a point [byte]."""
BESIDE = 7.0
"""Approximate size of a point without the lower bits of its gap [bit]."""
INTENSITY = 6.0
"""Approximate size of a point's intensity [bit]."""
SPARE = 0.7
"""Added to the estimated number of chunks: one chunk too few takes another try."""

LEAST_POINTS = 64
"""Minimum number of points in a chunk, where more chunks are made than needed."""

TRIES = 5
"""Maximum number of tries to find the number of chunks."""
FULL = 0.95
"""Fewer chunks are tried where chunks are filled to less than this part."""
MARGIN = 1.01
"""Factor of the number of chunks to try next: a chunk's size is not quite proportional to its points."""


class Dealt(NamedTuple):
    """Points that were dealt to chunks, as numbers."""
    centres: IntArray
    """(chunks,) int: about what the hashes of each are."""
    sequences: List[Numbers]

    @property
    def size(self) -> int:
        """Size of the largest chunk [byte]."""
        return 1 + int(np.sum([numbers.sizes for numbers in self.sequences], axis=0).max())

    @property
    def codes(self) -> bytes:
        """What is needed to read any chunk."""
        return b''.join(numbers.code.write() for numbers in self.sequences)


def can_sort(point_format: PointFormat) -> bool:
    """Whether points in this format can be sorted."""
    return bool(point_format.step) and sum(point_format.bits) <= MAX_KEY


def encode(points: Array, intensity: Optional[Float32Array], point_format: PointFormat,
           room: int, least: int = 1) -> Optional[Chunks]:
    """The fewest chunks found that fit.

    :param points: (n, 3) [m], 1 <= n <= MAX_POINTS
    :param intensity: (n,) float32, or None
    :param point_format: that has offsets
    :param room: in a datagram for a chunk and the codes [byte]
    :param least: number of chunks at least, of clouds with LEAST_POINTS for each
    :return: None where none was found that fits: the offsets need too many bits, or hardly a point fits
    """
    if not can_sort(point_format) or len(points) > MAX_POINTS:
        return None
    keys = keys_of(point_format.offsets(points), point_format.bits)
    order = np.argsort(keys, kind='stable')
    keys = keys[order]
    levels = None if intensity is None else point_format.levels(intensity)[order]
    dealt = _fitting(keys, levels, sum(point_format.bits), room, max(1, min(least, len(keys) // LEAST_POINTS)))
    return None if dealt is None else Chunks(
        dealt.codes, write(dealt.centres[:, np.newaxis], dealt.sequences, dealt.size))


def _fitting(keys: Array, levels: Optional[IntArray], key_bits: int, room: int, least: int) -> Optional[Dealt]:
    """Points in chunks that fit, as few as were found; None: none that fit were found.

    :param keys: (n,) uint64, ascending
    :param levels: (n,) int: intensities, 0..255
    :param least: number of chunks
    """
    best = None
    chunks = max(least, _first_guess(keys, levels is not None, room))
    for _ in range(TRIES):
        if chunks > min(len(keys), MAX_CHUNKS):
            break
        dealt = _dealt(keys, levels, chunks, key_bits)
        filled = (dealt.size + len(dealt.codes)) / room
        if filled > 1:
            if best is not None:
                break
            least = chunks + 1
            chunks = max(least, int(np.ceil(chunks * filled * MARGIN)))
            continue
        best = dealt
        fewer = max(least, int(np.ceil(chunks * filled * MARGIN)))
        if filled > FULL or fewer >= chunks:
            break
        chunks = fewer
    return best


def _first_guess(keys: Array, has_intensity: bool, room: int) -> int:
    """An estimate of the number of chunks: the gaps in a chunk are like those of every n-th key."""
    chunks = min(int(FIRST_GUESS * len(keys) / room) + 1, len(keys) - 1)
    bits = BESIDE + INTENSITY * has_intensity
    if chunks:
        bits += max(float(bit_lengths((keys[chunks:] - keys[:-chunks]) >> np.uint64(HASHED)).mean()) - 1, 0.0)
    return max(1, int(np.ceil(len(keys) * bits / 8 / room + SPARE)))


def dealing_order(hashes: IntArray, chunks: int) -> IntArray:
    """The order of sorted points in which they are dealt.

    :param hashes: (n,) int, below 256
    :return: (n,) int: chunk i has the elements i, i + chunks, ...; within each they are ascending
    """
    order, done = [], 0
    for depth in (2, 1) if chunks >= MANY else (1,):
        groups = (len(hashes) - done) // (depth * chunks)
        grouped = hashes[done:done + groups * depth * chunks].astype(np.uint8).reshape(groups, depth * chunks)
        ranks = np.argsort(grouped, axis=1, kind='stable')
        ranks = np.sort(ranks.reshape(groups, chunks, depth), axis=2)
        firsts = done + np.arange(groups)[:, np.newaxis, np.newaxis] * depth * chunks
        order.append((np.swapaxes(ranks, 1, 2) + firsts).reshape(-1))
        done += grouped.size
    order.append(done + np.argsort(hashes[done:], kind='stable'))
    return np.concatenate(order)


def hashes_of(keys: Array, hashed: int) -> IntArray:
    """(n,) int: of each key, below 2 ** hashed."""
    own = keys + spread(keys >> np.uint64(hashed), hashed)
    hashes: IntArray = (own & np.uint64((1 << hashed) - 1)).astype(int)
    return hashes


def spread(higher: Array, hashed: int) -> Array:
    """(...) uint64 below 2 ** hashed, of the keys' higher bits."""
    highest: Array = higher * GOLDEN >> np.uint64(63) - np.uint64(hashed) >> np.uint64(1)
    return highest


def _dealt(keys: Array, levels: Optional[IntArray], chunks: int, key_bits: int) -> Dealt:
    """Sorted points in this many chunks, however large they become.

    :param keys: (n,) uint64, ascending
    :param levels: (n,) int: intensities, 0..255
    """
    hashed = min(HASHED, key_bits)
    hashes = hashes_of(keys, hashed)
    order = dealing_order(hashes, chunks)
    valid = _by_chunk(np.ones(len(keys), bool), chunks)
    higher, own = (_by_chunk(values[order], chunks) for values in (keys >> np.uint64(hashed), hashes))
    centres = np.rint(own.sum(axis=1) / valid.sum(axis=1)).astype(int)
    half = 1 << hashed >> 1
    beside = (own - centres[:, np.newaxis] + half) % (2 * half) - half if half else own
    sequences = [_gaps(higher), zigzag(beside)]
    if levels is not None:
        changes = _gaps(_by_chunk(levels[order], chunks))
        sequences.append(zigzag((changes + 128) % 256 - 128))
    return Dealt(centres, [numbers_of(values, valid) for values in sequences])


def _by_chunk(values: Array, chunks: int) -> Array:
    """(chunks, rows) array of dealt (n,) values; 0 behind those of a chunk that is one shorter."""
    rows = -(-len(values) // chunks)
    padded = np.zeros(rows * chunks, values.dtype)
    padded[:len(values)] = values
    by_chunk: Array = np.ascontiguousarray(padded.reshape(rows, chunks).T)
    return by_chunk


def _gaps(values: Array) -> Array:
    """Each value less the one before in its row; the first as it is."""
    gaps = values.copy()
    gaps[:, 1:] -= values[:, :-1]
    return gaps
