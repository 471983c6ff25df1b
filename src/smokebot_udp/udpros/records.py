# SPDX-License-Identifier: BSD-3-Clause
"""Serialised ROS messages as rows of a numpy array: many messages written or read at once.

A message's bytes have a fixed layout once the lengths of its strings and arrays are known. `record_dtype`
makes that layout a structured dtype, so that a whole frame's messages are a few array assignments; the
bytes equal genpy's. Each field keeps its ROS name; the u32 length before a variable one is `<name>_length`.

Source: the ROS 1 serialisation (little-endian, no padding), as genpy/generator.py writes it.
"""
import functools
import re
import struct

import numpy as np
from genpy.message import get_message_class

PRIMITIVES = {'bool': 'u1', 'byte': 'i1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1', 'int16': '<i2', 'uint16': '<u2',
              'int32': '<i4', 'uint32': '<u4', 'int64': '<i8', 'uint64': '<u8', 'float32': '<f4', 'float64': '<f8'}
TIME = np.dtype([('secs', '<u4'), ('nsecs', '<u4')])
DURATION = np.dtype([('secs', '<i4'), ('nsecs', '<i4')])
_ARRAY = re.compile(r'(.+)\[(\d*)\]$')


class LayoutError(ValueError):
    """The bytes are no such message, or the type has no record layout (arrays of varying elements)."""


def record_dtype(message_class, lengths):
    """The dtype of message_class's bytes for given lengths.

    :param lengths: {dotted field name: number of bytes (strings) or elements (arrays)}; those not named are 0
    :raises LayoutError: where an array's elements vary in size themselves, or a name is no such field
    """
    return _record_dtype(message_class, tuple(sorted(lengths.items())))


@functools.lru_cache(maxsize=256)
def _record_dtype(message_class, lengths):
    left = dict(lengths)
    dtype = _dtype(message_class, '', left)
    if left:
        raise LayoutError('%s has no field of varying length named %s' % (message_class._type, ', '.join(left)))
    return dtype


def _dtype(message_class, prefix, left):
    fields = []
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        path = prefix + name
        array = _ARRAY.match(slot_type)
        if slot_type == 'string' or (array and not array.group(2)):
            count = left.pop(path, 0)
            base = 'u1' if slot_type == 'string' else _element(array.group(1))
            fields += [(name + '_length', '<u4'), (name, base, (count,))]
        elif array:
            fields.append((name, _element(array.group(1)), (int(array.group(2)),)))
        else:
            fields.append((name, _plain(slot_type) or _dtype(_class(slot_type), path + '.', left)))
    return np.dtype(fields)


def _plain(slot_type):
    return {'time': TIME, 'duration': DURATION}.get(slot_type) or PRIMITIVES.get(slot_type)


def _class(slot_type):
    message_class = get_message_class('std_msgs/Header' if slot_type == 'Header' else slot_type)
    if message_class is None:
        raise LayoutError('the message type %s is not installed' % slot_type)
    return message_class


@functools.lru_cache(maxsize=256)
def _element(slot_type):
    """An array element's dtype: it must not vary itself."""
    if _plain(slot_type):
        return np.dtype(_plain(slot_type))
    if slot_type == 'string' or any(t == 'string' or t.endswith('[]') for t in _class(slot_type)._slot_types):
        raise LayoutError('an array of %s has no record layout: its elements vary in size' % slot_type)
    return _dtype(_class(slot_type), '', {})


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
        array = _ARRAY.match(slot_type)
        if slot_type == 'string' or (array and not array.group(2)):
            count, = struct.unpack_from('<I', data, at)
            lengths[prefix + name] = count
            at += 4 + count * (1 if slot_type == 'string' else _element(array.group(1)).itemsize)
        elif array:
            at += int(array.group(2)) * _element(array.group(1)).itemsize
        elif _plain(slot_type):
            at += np.dtype(_plain(slot_type)).itemsize
        else:
            at = _walk(_class(slot_type), prefix + name + '.', data, at, lengths)
    return at


def write_lengths(records, message_class):
    """Fill in every `<name>_length` of the records: the layout's own lengths."""
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        if name + '_length' in records.dtype.names:
            records[name + '_length'] = records.dtype[name].shape[0]
        elif not _plain(slot_type) and not _ARRAY.match(slot_type):
            write_lengths(records[name], _class(slot_type))


def same_layout(records, message_class):
    """(n,) bool: the records whose own length fields agree with the dtype they are seen through."""
    agree = np.ones(len(records), bool)
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        if name + '_length' in records.dtype.names:
            agree &= records[name + '_length'] == records.dtype[name].shape[0]
        elif not _plain(slot_type) and not _ARRAY.match(slot_type):
            agree &= same_layout(records[name], _class(slot_type))
    return agree


def has_header(message_class):
    """Whether publishing numbers this type's messages: its first field is a std_msgs/Header."""
    return bool(getattr(message_class, '_has_header', False))
