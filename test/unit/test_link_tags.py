# SPDX-License-Identifier: BSD-3-Clause
"""Tags of handshake packets: golden bytes, and what is none."""
import hashlib
from typing import Any

import pytest

from smokebot_udp.link.packets import NO_TAG, Cookie, Hello, Init, Suite, parse
from smokebot_udp.link.tags import PURPOSE, TAG_AT, Tags

KEY = bytes(range(32))
PACKETS = [Hello(2, 7), Cookie(2, Suite.AESGCM, 7, b'c' * 16),
           Init(2, Suite.AESGCM, 7, b'c' * 16, 5, b'm' * 199)]
NAMES = pytest.mark.parametrize('packet', PACKETS, ids=lambda packet: type(packet).__name__)


@NAMES
def test_a_tag_is_the_mac_of_all_other_bytes(packet: Any) -> None:
    plain, tagged, at = packet.pack(), Tags(KEY).tagged(packet), TAG_AT[type(packet)]
    others = plain[:at] + plain[at + 16:]
    key = hashlib.blake2s(PURPOSE, key=KEY).digest()
    assert tagged.tag == hashlib.blake2s(others, digest_size=16, key=key).digest()
    assert tagged.pack()[at:at + 16] == tagged.tag and tagged._replace(tag=NO_TAG) == packet
    assert Tags(KEY).is_right(tagged) and not Tags(bytes(32)).is_right(tagged) and not Tags(KEY).is_right(packet)


@NAMES
def test_a_bit_that_is_changed_anywhere_shows(packet: Any) -> None:
    datagram = Tags(KEY).tagged(packet).pack()
    for at in range(len(datagram)):
        changed = datagram[:at] + bytes([datagram[at] ^ 1]) + datagram[at + 1:]
        try:
            read: Any = parse(changed)
        except ValueError:
            continue
        if type(read) is type(packet) and read != parse(datagram):
            assert not Tags(KEY).is_right(read), at
