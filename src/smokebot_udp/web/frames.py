# SPDX-License-Identifier: BSD-3-Clause
"""Binary frames to a browser: a header, metadata in JSON, data. doc/web_protocol.md has their layout."""
import enum
import json
import math
import struct
from typing import Any, Mapping, NamedTuple, Optional

HEADER = struct.Struct('<BBHIII')
"""Kind, level, stream's index, number, length of the metadata, length of the data."""


class Kind(enum.IntEnum):
    """What a frame carries."""
    IMAGE = 1
    TILE = 2
    AGES = 3
    POINTS = 4
    CLOUD = 5


class Frame(NamedTuple):
    """A binary frame."""
    kind: Kind
    stream: int
    """Its index."""
    metadata: Mapping[str, Any]
    data: bytes
    level: int = 0
    """Level of a tile."""

    def serialised(self, number: int) -> bytes:
        """The bytes to send.

        :param number: of the frame, for this browser
        """
        metadata = text_of(self.metadata).encode()
        return b''.join((HEADER.pack(self.kind, self.level, self.stream, number & 0xFFFFFFFF, len(metadata),
                                     len(self.data)), metadata, self.data))


class Parsed(NamedTuple):
    """A frame as a browser reads it."""
    frame: Frame
    number: int


def parse(content: bytes) -> Parsed:
    """A frame from its bytes.

    :raises ValueError: they are no frame
    """
    if len(content) < HEADER.size:
        raise ValueError('a frame has at least %d bytes' % HEADER.size)
    kind, level, index, number, metadata, data = HEADER.unpack_from(content)
    if len(content) != HEADER.size + metadata + data:
        raise ValueError('a frame of %d bytes has %d' % (HEADER.size + metadata + data, len(content)))
    return Parsed(Frame(Kind(kind), index, json.loads(content[HEADER.size:HEADER.size + metadata].decode()),
                        content[HEADER.size + metadata:], level), number)


def finite(value: float, digits: int = 5) -> Optional[float]:
    """A number as it may be in a message; None: it is infinite or NaN.

    :param digits: after the point
    """
    return round(float(value), digits) if math.isfinite(value) else None


def text_of(message: Mapping[str, Any]) -> str:
    """A message as JSON, short.

    :raises ValueError: a number is not finite
    """
    return json.dumps(message, allow_nan=False, separators=(',', ':'))
