# SPDX-License-Identifier: BSD-3-Clause
"""Fields of a point cloud beside coordinates and intensity, such as rgb and ring: their names, types and bytes.

Values cross as they are, whatever their type: little-endian, one field after the other, without padding.
"""
import functools
import re
from typing import NamedTuple, Sequence, Tuple

import numpy as np

from ...arrays import DType
from .points import DATATYPES

MAX_FIELDS = 32
NAME = re.compile(r'[!-+\--9;-~]{1,64}')
"""Printable ASCII without comma, colon and space."""

COORDINATES = 'x', 'y', 'z'


class CloudField(NamedTuple):
    """A field with one value a point."""
    name: str
    datatype: int
    """As of sensor_msgs/PointField."""


Fields = Tuple[CloudField, ...]


@functools.lru_cache(maxsize=64)
def names_of(text: str) -> Tuple[str, ...]:
    """The names in the setting `fields`, separated by commas or spaces, without coordinates, which always cross.

    :raises ValueError: naming what is not the name of a field
    """
    names = tuple(name for name in dict.fromkeys(text.replace(',', ' ').split()) if name not in COORDINATES)
    for name in names:
        if not NAME.fullmatch(name):
            raise ValueError('fields has %r, must be names of up to 64 ASCII characters without colon' % name)
    if len(names) > MAX_FIELDS:
        raise ValueError('fields has %d names; there may be %d' % (len(names), MAX_FIELDS))
    return names


def write_fields(fields: Sequence[CloudField]) -> bytes:
    """The fields as datagrams name them: name:datatype, separated by commas."""
    return ','.join('%s:%d' % field for field in fields).encode()


@functools.lru_cache(maxsize=64)
def read_fields(text: str) -> Fields:
    """The inverse of write_fields, of what comes from the network.

    :raises ValueError: the text is not what write_fields writes
    """
    items = text.split(',', MAX_FIELDS) if text else []
    found = []
    for item in items:
        name, _, datatype = item.rpartition(':')
        if not (NAME.fullmatch(name) and datatype in map(str, DATATYPES)):
            raise ValueError('field %.80r, must be name:datatype' % item)
        found.append(CloudField(name, int(datatype)))
    names = {field.name for field in found}
    if len(found) > MAX_FIELDS or len(names) < len(found) or names & {*COORDINATES}:
        raise ValueError('fields %.200r: too many, twice the same, or coordinates' % text)
    return tuple(found)


def bytes_dtype(fields: Fields) -> DType:
    """The dtype of a point's further fields: unsigned integers that have the bytes of the values."""
    return np.dtype([(field.name, '<u%d' % np.dtype(DATATYPES[field.datatype]).itemsize) for field in fields])
