# SPDX-License-Identifier: BSD-3-Clause
"""NAL units of an H.264 byte stream (ITU-T H.264, 7.3.1 and annex B)."""
import re
from enum import IntEnum
from typing import Iterable, List

START_CODE = b'\0\0\0\1'
"""Start code in front of each NAL unit of a byte stream."""

_START_CODES = re.compile(b'\0*\0\0\1')


class UnitType(IntEnum):
    """Values of nal_unit_type that libx264 writes; see table 7-1."""
    SLICE = 1
    """Slice of an image that is predicted from others."""
    IDR_SLICE = 5
    """Slice of an image with which decoding may begin."""
    SEI = 6
    SEQUENCE_PARAMETERS = 7
    PICTURE_PARAMETERS = 8


SLICES = (UnitType.SLICE, UnitType.IDR_SLICE)
PARAMETER_SETS = (UnitType.SEQUENCE_PARAMETERS, UnitType.PICTURE_PARAMETERS)


def split(stream: bytes) -> List[bytes]:
    """The NAL units of a byte stream, without start codes and the zeros between; none is empty."""
    return [unit for unit in (part.rstrip(b'\0') for part in _START_CODES.split(stream)[1:]) if unit]


def byte_stream(units: Iterable[bytes]) -> bytes:
    """NAL units with a start code in front of each."""
    return b''.join(START_CODE + unit for unit in units)


def unit_type(unit: bytes) -> int:
    """nal_unit_type; 0, which is unspecified, of an empty unit."""
    return unit[0] & 31 if unit else 0
