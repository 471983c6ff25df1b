# SPDX-License-Identifier: BSD-3-Clause
"""What the segments of every kind have in common: a header, room for data, and what all of one message say alike."""
import functools
import io
from types import SimpleNamespace

import numpy as np

from ..udpros.datagram import OVERHEAD


@functools.lru_cache(maxsize=None)
def _fixed_size(segment_class):
    """Bytes of a serialised segment whose texts and arrays are empty."""
    buffer = io.BytesIO()
    segment_class().serialize(buffer)
    return len(buffer.getvalue())


def room(segment_class, max_datagram_size, *texts):
    """Bytes that a datagram leaves for a segment's data beside its fixed fields and some texts.

    :raises ValueError: where nothing is left
    """
    left = max_datagram_size - OVERHEAD - _fixed_size(segment_class) - sum(map(len, texts))
    if left <= 0:
        raise ValueError('a datagram of %d bytes has no room beside its texts %s' % (max_datagram_size, texts))
    return left


def as_bytes(text):
    """A text as an array for a record: (n,) uint8."""
    return np.frombuffer(text.encode() if isinstance(text, str) else bytes(text), np.uint8)


def write_header(records, header):
    """The source's stamp and frame into all of a frame's records; their seq is the publisher's."""
    records['header']['stamp']['secs'], records['header']['stamp']['nsecs'] = header.stamp.secs, header.stamp.nsecs
    records['header']['frame_id'] = as_bytes(header.frame_id)


def stamps_of(records, rows):
    """(m,) int64: the stamps of some records [ns]."""
    stamps = records['header']['stamp'][rows]
    return stamps['secs'].astype(np.int64) * 10 ** 9 + stamps['nsecs']


def head_of(record, segment_class, fields):
    """What one segment says of the whole: stamp [ns], frame_id and the fields named, as attributes.

    Texts are str, whole arrays and messages are tuples; heads compare by value.
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


def same_head(records, rows, fields):
    """(m,) bool: those of the rows that say what the first of them says; the first always does."""
    # byte by byte: a NaN is equal to itself, and all fields are compared at once
    raw = records.view((np.uint8, records.dtype.itemsize))
    heads = raw[rows[:, np.newaxis], _places(records.dtype, fields)]
    return (heads == heads[0]).all(axis=1)


@functools.lru_cache(maxsize=64)
def _places(dtype, fields):
    """(k,) int: where a record's bytes are that tell its frame_id and these fields."""
    header, at = dtype.fields['header'][:2]
    frame_id, within = header.fields['frame_id'][:2]
    parts = [(frame_id, at + within)] + [dtype.fields[field][:2] for field in fields]
    return np.concatenate([np.arange(at, at + part.itemsize) for part, at in parts])


def picked(records, rows):
    """records[rows], of rows ascending; not copied where they follow each other."""
    if rows[-1] - rows[0] + 1 == len(rows):
        return records[rows[0]:rows[-1] + 1]
    return records[rows]


def _text(field):
    return field.tobytes().decode('utf-8', 'replace')
