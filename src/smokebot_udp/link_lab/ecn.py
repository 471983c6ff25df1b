# SPDX-License-Identifier: BSD-3-Clause
"""Explicit congestion notification in IPv4 headers (RFC 3168, section 5)."""

ECN = 0x03
"""The bits of the header's second byte: 0: not capable, 1 and 2: capable (ECT), 3: congestion experienced (CE)."""

CE = 0x03


def is_capable(packet: bytes) -> bool:
    """Whether the sender of an IPv4 packet would see its mark."""
    return packet[0] >> 4 == 4 and len(packet) >= 20 and bool(packet[1] & ECN)


def marked(packet: bytes) -> bytes:
    """An IPv4 packet with the mark CE; its header's checksum is updated as in RFC 1624, equation 3."""
    before, checksum = int.from_bytes(packet[:2], 'big'), int.from_bytes(packet[10:12], 'big')
    after = before | CE
    total = (~checksum & 0xffff) + (~before & 0xffff) + after
    total = (total & 0xffff) + (total >> 16)
    total = (total & 0xffff) + (total >> 16)
    return after.to_bytes(2, 'big') + packet[2:10] + (~total & 0xffff).to_bytes(2, 'big') + packet[12:]
