# SPDX-License-Identifier: BSD-3-Clause
"""The checksum of a serialised message that crosses the link: also one of another type than expected is noticed."""
import zlib


def typed_checksum(md5sum: str, data: bytes) -> int:
    """CRC-32 of the md5sum of a message's type, as text, and of the serialised message.

    :return: uint32
    """
    return zlib.crc32(data, zlib.crc32(md5sum.encode()))
