# SPDX-License-Identifier: BSD-3-Clause
"""Serialised ROS messages as rows of a numpy array: many messages written or read at once.

A message's bytes have a fixed layout once the lengths of its strings and arrays are known. `record_dtype`
makes that layout a structured dtype, so that a whole frame's messages are a few array assignments; the
bytes equal genpy's. Each field keeps its ROS name; the u32 length before a variable one is `<name>_length`.

Source: the ROS 1 serialisation (little-endian, no padding), as genpy/generator.py writes it.
"""
import functools
import operator
import re
import struct

import numpy as np
from genpy.message import get_message_class

TIME = np.dtype([('secs', '<u4'), ('nsecs', '<u4')])
DURATION = np.dtype([('secs', '<i4'), ('nsecs', '<i4')])
PLAIN = {name: np.dtype(code) for name, code in {
    'bool': 'u1', 'byte': 'i1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1', 'int16': '<i2', 'uint16': '<u2',
    'int32': '<i4', 'uint32': '<u4', 'int64': '<i8', 'uint64': '<u8', 'float32': '<f4', 'float64': '<f8',
    'time': TIME, 'duration': DURATION}.items()}
_ARRAY = re.compile(r'(.+)\[(\d*)\]$')


class LayoutError(ValueError):
    """The bytes are no such message, or the type has no record layout (arrays of varying elements)."""


def record_dtype(message_class, lengths):
    """The dtype of message_class's bytes for given lengths.

    :param lengths: {dotted field name: number of bytes (strings) or elements (arrays)}; those not named are 0
    :raises LayoutError: where an array's elements vary in size themselves, a name is no such field, or no dtype
        is so long
    """
    return _record_dtype(message_class, tuple(sorted(lengths.items())))


@functools.lru_cache(maxsize=256)
def _record_dtype(message_class, lengths):
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


def _dtype(message_class, prefix, left):
    fields = []
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
def _array(slot_type):
    """(an element's dtype, how many or None where that varies) of a string or an array; (None, None) of others."""
    if slot_type == 'string':
        return np.dtype('u1'), None
    array = _ARRAY.match(slot_type)
    if not array:
        return None, None
    return _element(array.group(1)), int(array.group(2)) if array.group(2) else None


def _class(slot_type):
    message_class = get_message_class('std_msgs/Header' if slot_type == 'Header' else slot_type)
    if message_class is None:
        raise LayoutError('the message type %s is not installed' % slot_type)
    return message_class


def _element(slot_type):
    """An array element's dtype: it must not vary itself, and not be empty."""
    if slot_type in PLAIN:
        return PLAIN[slot_type]
    if slot_type == 'string' or varying_fields(_class(slot_type)):
        raise LayoutError('an array of %s has no record layout: its elements vary in size' % slot_type)
    dtype = _dtype(_class(slot_type), '', {})
    if not dtype.itemsize:
        raise LayoutError('an array of %s has no record layout: its elements are empty' % slot_type)
    return dtype


@functools.lru_cache(maxsize=256)
def varying_fields(message_class):
    """The paths of its strings and arrays of varying length, in their order: (('header', 'frame_id'), ...)."""
    paths = []
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        element, count = _array(slot_type)
        if element is not None:
            paths += [(name,)] if count is None else []
        elif slot_type not in PLAIN:
            paths += [(name,) + path for path in varying_fields(_class(slot_type))]
    return tuple(paths)


def lengths_of(message_class, data):
    """The lengths of one serialised message's varying fields, as record_dtype takes them.

    :param data: bytes-like
    :raises LayoutError: where the bytes end early, or go on behind the message
    """
    lengths = {}
    try:
        end = _walk(message_class, '', data, 0, lengths)
    except struct.error:
        raise LayoutError('%d bytes are too few for a %s' % (len(data), message_class._type)) from None
    if end != len(data):
        raise LayoutError('a %s of these lengths has %d bytes, not %d' % (message_class._type, end, len(data)))
    return lengths


def _walk(message_class, prefix, data, at, lengths):
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        element, count = _array(slot_type)
        if element is not None:
            if count is None:
                count, = struct.unpack_from('<I', data, at)
                lengths[prefix + name] = count
                at += 4
            at += count * element.itemsize
        elif slot_type in PLAIN:
            at += PLAIN[slot_type].itemsize
        else:
            at = _walk(_class(slot_type), prefix + name + '.', data, at, lengths)
    return at


def write_lengths(records, message_class):
    """Fill in every `<name>_length` of the records: the layout's own lengths."""
    for lengths, expected in _length_fields(records, message_class):
        lengths[...] = expected


def same_layout(records, message_class):
    """(n,) bool: the records whose own length fields agree with the dtype they are seen through."""
    agree = np.ones(len(records), bool)
    for lengths, expected in _length_fields(records, message_class):
        agree &= lengths == expected
    return agree


def _length_fields(records, message_class):
    """Of every varying field: its (n,) lengths in the records, and its length in their dtype."""
    for *outer, name in varying_fields(message_class):
        inner = functools.reduce(operator.getitem, outer, records)
        yield inner[name + '_length'], inner.dtype[name].shape[0]


def has_header(message_class):
    """Whether publishing numbers this type's messages: its first field is a std_msgs/Header."""
    return bool(getattr(message_class, '_has_header', False))
