# SPDX-License-Identifier: BSD-3-Clause
"""What the segments of all kinds have in common: a topic, a header, room for data, and fields that all segments of
one message repeat (its head)."""
import functools
from types import SimpleNamespace
from typing import Any, Iterable, List, Sequence, Tuple, Union

import numpy as np

from ..arrays import BoolArray, IntArray, Records, UInt8Array
from ..serialised import serialised
from ..udpros.datagram import IP_UDP_HEADERS, OVERHEAD
from ..udpros.frame import Frame

MAIN_PART = 'segments'
"""The part of a stream that every kind has. A kind that sends segments of several types has a part for each type."""

LAYERS = 'layers'
"""The part of a stream of images that carries layered ones."""

VIDEO = 'video'
"""The part of a stream of images that carries slices of H.264."""

ARRIVAL = 'arrival'
"""The field of segments that says when their message came, where its stamp does not say how old it is, or which."""

INFO = 'camera_info'
"""The part of a stream of images that carries their calibration."""

TILES = 'tiles'
"""The part of a stream of maps that carries tiles."""

MAX_SOURCES = 8
"""Number of sources of one stream whose state is remembered, such as the echoes of one scanner: their frame_id, which
comes from messages and from the network, distinguishes them."""


def wire_topic(name: str, part: str = MAIN_PART) -> str:
    """The topic on which a stream's segments are sent: the same for all nodes, whatever their namespaces."""
    return '/smokebot_udp/%s/%s' % (name, part)


def reported_name(name: str, part: str = MAIN_PART) -> str:
    """The name of a part of a stream in link reports."""
    return name if part == MAIN_PART else '%s/%s' % (name, part)


def size_on_air(frames: Iterable[Frame]) -> int:
    """Size of frames as IP packets [byte]."""
    return sum(len(frame) * (frame.datagram_size + IP_UDP_HEADERS) for frame in frames)


@functools.lru_cache(maxsize=None)
def _fixed_size(segment_class: Any) -> int:
    """Size of a serialised segment whose strings and arrays are empty [byte]."""
    return len(serialised(segment_class()))


def room(segment_class: Any, max_datagram_size: int, *texts: Union[str, bytes]) -> int:
    """The room that a segment's fixed fields and some strings leave in a datagram [byte].

    :param max_datagram_size: [byte of UDP payload]
    :raises ValueError: where nothing is left
    """
    left = max_datagram_size - OVERHEAD - _fixed_size(segment_class) - sum(map(len, texts))
    if left <= 0:
        raise ValueError('a datagram of %d bytes has no room beside its texts %s' % (max_datagram_size, texts))
    return left


def as_bytes(text: Union[str, bytes]) -> UInt8Array:
    """A string as a record's field holds it: (n,) uint8, UTF-8."""
    return np.frombuffer(text.encode() if isinstance(text, str) else bytes(text), np.uint8)


def write_header(records: Records, header: Any) -> None:
    """Write stamp and frame_id of a std_msgs/Header into all records of a frame; their seq is the publisher's."""
    records['header']['stamp']['secs'], records['header']['stamp']['nsecs'] = header.stamp.secs, header.stamp.nsecs
    records['header']['frame_id'] = as_bytes(header.frame_id)


def stamps_of(records: Records, rows: IntArray) -> IntArray:
    """(m,) int64: the stamps of some records [ns].

    :param records: (n,) structured array of segments
    :param rows: (m,) indexes
    """
    stamps = records['header']['stamp'][rows]
    nanoseconds: IntArray = stamps['secs'].astype(np.int64) * 10 ** 9 + stamps['nsecs']
    return nanoseconds


def frames_of(records: Records, rows: IntArray) -> List[IntArray]:
    """The rows of each message, as far as they follow each other: they have one stamp, frame_id and arrival.

    :param records: (n,) structured array of segments
    :param rows: (m,) indexes, m >= 1
    """
    places = _places(records.dtype, (ARRIVAL,), True)
    identities = records.view((np.uint8, records.dtype.itemsize))[rows[:, np.newaxis], places]
    return np.split(rows, np.flatnonzero((identities[1:] != identities[:-1]).any(axis=1)) + 1)


def nanoseconds(time: Tuple[int, int]) -> int:
    """Number of nanoseconds of a time as `head_of` has it: seconds and nanoseconds."""
    return time[0] * 10 ** 9 + time[1]


def head_of(record: Any, segment_class: Any, fields: Sequence[str]) -> SimpleNamespace:
    """The head of one segment: stamp [ns], frame_id and the fields named, as attributes.

    Strings are str, arrays and messages are tuples; heads compare by value.

    :param record: element of a structured array of segments
    """
    types = dict(zip(segment_class.__slots__, segment_class._slot_types))
    stamp = record['header']['stamp']
    head = SimpleNamespace(stamp=int(stamp['secs']) * 10 ** 9 + int(stamp['nsecs']),
                           frame_id=_text(record['header']['frame_id']))
    for field in fields:
        value = record[field]
        setattr(head, field, _text(value) if types[field] == 'string' else
                tuple(value.tolist()) if value.ndim else value.item())
    return head


def same_head(records: Records, rows: IntArray, fields: Sequence[str]) -> BoolArray:
    """(m,) bool: which of the rows have the frame_id and the fields of the first one; the first always does.

    :param records: (n,) structured array of segments
    :param rows: (m,) indexes
    """
    # byte by byte: a NaN is equal to itself, and all fields are compared at once
    raw = records.view((np.uint8, records.dtype.itemsize))
    heads = raw[rows[:, np.newaxis], _places(records.dtype, tuple(fields))]
    same: BoolArray = (heads == heads[0]).all(axis=1)
    return same


@functools.lru_cache(maxsize=64)
def _places(dtype: Any, fields: Tuple[str, ...], stamp: bool = False) -> IntArray:
    """(k,) int: offsets of the bytes of frame_id and these fields in a record, and of the header's stamp."""
    header, at = dtype.fields['header'][:2]
    parts = [(header.fields[name][0], at + header.fields[name][1]) for name in ['frame_id'] + ['stamp'] * stamp]
    parts += [dtype.fields[field][:2] for field in fields]
    return np.concatenate([np.arange(at, at + part.itemsize) for part, at in parts])


def picked(records: Records, rows: IntArray) -> Records:
    """records[rows], without a copy where the rows are consecutive.

    :param rows: (m,) indexes, ascending
    """
    if rows[-1] - rows[0] + 1 == len(rows):
        return records[rows[0]:rows[-1] + 1]
    return records[rows]


def _text(field: Any) -> str:
    text: str = field.tobytes().decode('utf-8', 'replace')
    return text
