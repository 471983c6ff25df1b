# SPDX-License-Identifier: BSD-3-Clause
"""Messages in as few bytes as they take: text and the zeros of covariances shrink to a fraction."""
import zlib
from typing import Any

PLAIN, DEFLATED = b'\0', b'\1'
"""The first byte: what follows is the message, or compressed (RFC 1950)."""

UNPACKED = 1
"""What a message that is not worth compressing takes more [byte]."""

MIN_SIZE = 256
"""Shorter messages stay as they are: there is little to gain [byte]."""

MAX_DEFLATED = 64 << 10
"""Longer messages stay as they are: they are images and the like, which are compressed already or would take long. So a
few forged datagrams cannot become a message that takes long to read [byte]."""

LEVEL = 6


def pack(data: bytes) -> bytes:
    """A message to be sent."""
    if MIN_SIZE <= len(data) <= MAX_DEFLATED:
        deflated = zlib.compress(data, LEVEL)
        if len(deflated) < len(data):
            return DEFLATED + deflated
    return PLAIN + data


def pack_beside(data: bytes, known: bytes) -> bytes:
    """A message for who has another one that resembles it: raw DEFLATE (RFC 1951) with that as dictionary."""
    deflater = zlib.compressobj(LEVEL, wbits=-zlib.MAX_WBITS, zdict=known)
    return deflater.compress(data) + deflater.flush()


def unpack_beside(packed: bytes, known: bytes) -> bytes:
    """The inverse of `pack_beside`.

    :raises ValueError: where it was not packed so, or is longer than MAX_DEFLATED
    """
    return inflated(packed, zlib.decompressobj(wbits=-zlib.MAX_WBITS, zdict=known), MAX_DEFLATED)


def unpack(packed: bytes, most: int) -> bytes:
    """The message that was packed.

    :param most: its longest size; nothing longer is unpacked [byte]
    :raises ValueError: where it is longer, or was not packed
    """
    kind, data = packed[:1], packed[1:]
    if kind == DEFLATED:
        return inflated(data, zlib.decompressobj(), min(most, MAX_DEFLATED))
    if kind != PLAIN:
        raise ValueError('it begins with %r' % kind)
    if len(data) > most:
        raise ValueError('it has more than %d bytes' % most)
    return data


def inflated(packed: bytes, inflater: Any, most: int) -> bytes:
    """What an inflater makes of one whole stream.

    :raises ValueError: where it is longer than `most`, or no such stream
    """
    try:
        data: bytes = inflater.decompress(packed, most + 1)
    except zlib.error as error:
        raise ValueError('it is not compressed: %s' % error) from None
    if len(data) > most:
        raise ValueError('it has more than %d bytes' % most)
    if not inflater.eof or inflater.unused_data:
        raise ValueError('its end is missing, or more follows')
    return data
