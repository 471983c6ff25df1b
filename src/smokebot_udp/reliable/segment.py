# SPDX-License-Identifier: BSD-3-Clause
"""The segments that two nodes exchange: the fields of msg/ReliableSegment, which explains them."""
import enum
from typing import NamedTuple

WINDOW = 256
"""Segments from the first one that is missing on that may be on their way; as many as an acknowledgement describes."""

MAX_NUMBER = 2 ** 32 - 1
"""Highest number of a segment, session or channel."""


class Kind(enum.IntEnum):
    """What a segment is; the values are those of msg/ReliableSegment."""
    GREETING = 0
    DATA = 1
    ADVANCE = 2
    ACKNOWLEDGEMENT = 3
    UNKNOWN = 4


class Segment(NamedTuple):
    """See msg/ReliableSegment."""
    kind: int
    channel: int = 0
    number: int = 0
    first: int = 0
    part: int = 0
    parts: int = 0
    next: int = 0
    echo: int = 0
    arrived: int = 0
    received: bytes = b''
    data: bytes = b''
    seq: int = 0
    session: int = 0
    peer: int = 0
