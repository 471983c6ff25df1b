# SPDX-License-Identifier: BSD-3-Clause
"""The tap of the link lab reads packets as they are on the wire, and the forger writes such."""
import socket
import struct

import pytest

from evaluation.forged_packets import packet
from evaluation.tap import arrival, parse

# RFC 791 and 768: 20 bytes of IP, 8 of UDP (ports 40000 and 17001, length 8 + 5, no checksum), 'hello'
HEAD = bytes.fromhex('45000021 00004000 4011 0000 0a4d0002 0a4d0001'.replace(' ', ''))
UDP = bytes.fromhex('9c40 4269 000d 0000'.replace(' ', '')) + b'hello'


def test_a_datagram() -> None:
    found = parse(HEAD + UDP, 5.0)
    assert found == (5.0, ('10.77.0.2', 40000), ('10.77.0.1', 17001), b'hello')


def test_ip_options_are_skipped() -> None:
    found = parse(b'\x46' + HEAD[1:] + bytes(4) + UDP, 5.0)
    assert found is not None and found.payload == b'hello' and found.to[1] == 17001


@pytest.mark.parametrize('other', [
    b'', b'\x45', HEAD, HEAD + UDP[:7], b'\x65' + HEAD[1:] + UDP,
    HEAD[:9] + bytes([socket.IPPROTO_TCP]) + HEAD[10:] + UDP,
    HEAD[:6] + b'\x20\x00' + HEAD[8:] + UDP, HEAD[:6] + b'\x00\x01' + HEAD[8:] + UDP],
    ids=['empty', 'short', 'no UDP', 'half a head', 'IPv6', 'TCP', 'first fragment', 'later fragment'])
def test_what_is_no_datagram(other) -> None:
    assert parse(other, 5.0) is None


def test_the_time_is_the_kernels() -> None:
    control = [(socket.SOL_SOCKET, 1, b'x'), (socket.SOL_SOCKET, 35, struct.pack('@2l', 7, 500000000))]
    assert arrival(control) == 7.5


def test_a_forged_packet_is_read_as_it_was_written() -> None:
    forged = packet(('10.78.1.2', 1234), ('10.77.0.1', 17001), b'evil')
    assert parse(forged, 0.0) == (0.0, ('10.78.1.2', 1234), ('10.77.0.1', 17001), b'evil')
