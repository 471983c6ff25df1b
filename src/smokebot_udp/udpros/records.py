# SPDX-License-Identifier: BSD-3-Clause
"""Serialised ROS messages as rows of a numpy array, to write or read many messages at once.

A message's bytes have a fixed layout once the lengths of its strings and arrays are known. `record_dtype` expresses
that layout as a structured dtype. All messages of a frame are then written by a few array assignments, and the bytes
equal genpy's. Each field keeps its ROS name; the u32 length in front of a variable one is `<name>_length`.

Source: the ROS 1 serialisation (little-endian, no padding), as genpy/generator.py writes it. Message classes are those
that genpy generates; they have no types, so they are Any here.
"""
import functools
import re
import struct
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

import numpy as np
from genpy.message import get_message_class

from ..arrays import Array, BoolArray, Records
from .datagram import Buffer

DType = Any
"""A np.dtype, which is generic in later versions of numpy only."""

TIME: DType = np.dtype([('secs', '<u4'), ('nsecs', '<u4')])
DURATION: DType = np.dtype([('secs', '<i4'), ('nsecs', '<i4')])
PLAIN: Dict[str, DType] = {name: np.dtype(code) for name, code in {
    'bool': 'u1', 'byte': 'i1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1', 'int16': '<i2', 'uint16': '<u2',
    'int32': '<i4', 'uint32': '<u4', 'int64': '<i8', 'uint64': '<u8', 'float32': '<f4', 'float64': '<f8'}.items()}
PLAIN.update(time=TIME, duration=DURATION)
"""{ROS type: dtype} of the types of fixed size that are not messages."""

LAYOUTS = 48
"""That are kept, of 10 KB each: the datagrams of a frame share one, and many never come again."""

_ARRAY = re.compile(r'(.+)\[(\d*)\]$')


class LayoutError(ValueError):
    """The bytes are not a message of the type, or the type has no record layout (arrays of elements that vary in size).
    """


def record_dtype(message_class: Any, lengths: Mapping[str, int]) -> DType:
    """The structured dtype of a serialised message for given lengths.

    :param lengths: {dotted field name: number of bytes (strings) or elements (arrays)}; others are 0
    :raises LayoutError: if the elements of an array vary in size, a name is not such a field, or the message is longer
        than numpy's dtypes (2 GiB)
    """
    return _record_dtype(message_class, tuple(sorted(lengths.items())))


@functools.lru_cache(maxsize=LAYOUTS)
def _record_dtype(message_class: Any, lengths: Tuple[Tuple[str, int], ...]) -> DType:
    left = dict(lengths)
    try:
        dtype = _dtype(message_class, '', left)
    except LayoutError:
        raise
    except ValueError as error:   # numpy: longer than 2 GiB, a negative length, or two fields of one name
        raise LayoutError('no layout for a %s: %s' % (message_class._type, error)) from error
    if left:
        raise LayoutError('%s has no field of varying length named %s' % (message_class._type, ', '.join(left)))
    return dtype


def _dtype(message_class: Any, prefix: str, left: Dict[str, int]) -> DType:
    fields: List[Any] = []
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        element, count = _array(slot_type)
        if element is None:
            inner = PLAIN[slot_type] if slot_type in PLAIN else _dtype(_class(slot_type), prefix + name + '.', left)
            fields.append((name, inner))
            continue
        if count is None:
            count = left.pop(prefix + name, 0)
            fields.append((name + '_length', '<u4'))
        fields.append((name, element, (count,)))
    return np.dtype(fields)


@functools.lru_cache(maxsize=256)
def _array(slot_type: str) -> Tuple[Optional[DType], Optional[int]]:
    """(dtype of an element, number of elements) of a string or an array, with None as the number if it varies; else
    (None, None)."""
    if slot_type == 'string':
        return np.dtype('u1'), None
    array = _ARRAY.match(slot_type)
    if not array:
        return None, None
    return _element(array.group(1)), int(array.group(2)) if array.group(2) else None


def _class(slot_type: str) -> Any:
    message_class = get_message_class('std_msgs/Header' if slot_type == 'Header' else slot_type)
    if message_class is None:
        raise LayoutError('the message type %s is not installed' % slot_type)
    return message_class


def _element(slot_type: str) -> DType:
    """The dtype of an array's element, which must neither vary in size nor be empty."""
    if slot_type in PLAIN:
        return PLAIN[slot_type]
    if slot_type == 'string' or varying_fields(_class(slot_type)):
        raise LayoutError('an array of %s has no record layout: its elements vary in size' % slot_type)
    dtype = _dtype(_class(slot_type), '', {})
    if not dtype.itemsize:
        raise LayoutError('an array of %s has no record layout: its elements are empty' % slot_type)
    return dtype


@functools.lru_cache(maxsize=256)
def varying_fields(message_class: Any) -> Tuple[Tuple[str, ...], ...]:
    """The paths of the strings and arrays of varying length, in their order: (('header', 'frame_id'), ...).

    :raises LayoutError: as record_dtype
    """
    paths: List[Tuple[str, ...]] = []
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        element, count = _array(slot_type)
        if element is not None:
            paths += [(name,)] if count is None else []
        elif slot_type not in PLAIN:
            paths += [(name,) + path for path in varying_fields(_class(slot_type))]
    return tuple(paths)


def lengths_of(message_class: Any, data: Buffer) -> Dict[str, int]:
    """The lengths of the varying fields of one serialised message, as record_dtype takes them.

    :raises LayoutError: if the data are shorter or longer than the message, or its type has no layout
    """
    lengths: Dict[str, int] = {}
    try:
        end = _walk(message_class, '', data, 0, lengths)
    except struct.error:
        raise LayoutError('%d bytes are too few for a %s' % (len(data), message_class._type)) from None
    if end != len(data):
        raise LayoutError('a %s of these lengths has %d bytes, not %d' % (message_class._type, end, len(data)))
    return lengths


def _walk(message_class: Any, prefix: str, data: Buffer, at: int, lengths: Dict[str, int]) -> int:
    """Note the lengths of a message that begins at `at`; returns where it ends."""
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        element, count = _array(slot_type)
        if element is not None:
            if count is None:
                count = int(struct.unpack_from('<I', data, at)[0])
                lengths[prefix + name] = count
                at += 4
            at += count * element.itemsize
        elif slot_type in PLAIN:
            at += PLAIN[slot_type].itemsize
        else:
            at = _walk(_class(slot_type), prefix + name + '.', data, at, lengths)
    return at


def write_lengths(records: Records, message_class: Any) -> None:
    """Write every `<name>_length` of the records, from the lengths in their dtype."""
    for lengths, expected in _length_fields(records, message_class):
        lengths[...] = expected


def same_layout(records: Records, message_class: Any) -> BoolArray:
    """(n,) bool: the records whose own length fields agree with their dtype."""
    agree = np.ones(len(records), bool)
    for lengths, expected in _length_fields(records, message_class):
        agree &= lengths == expected
    return agree


def _length_fields(records: Records, message_class: Any) -> Iterator[Tuple[Array, int]]:
    """For every varying field its (n,) lengths in the records, and its length in their dtype."""
    for *outer, name in varying_fields(message_class):
        inner: Any = records
        for field in outer:
            inner = inner[field]
        yield inner[name + '_length'], inner.dtype[name].shape[0]


def has_header(message_class: Any) -> bool:
    """Whether publishers number the messages of this type: its first field is a std_msgs/Header."""
    return bool(getattr(message_class, '_has_header', False))
