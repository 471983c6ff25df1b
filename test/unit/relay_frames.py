# SPDX-License-Identifier: BSD-3-Clause
"""A message in a relay's segments, for tests."""
from typing import Any

from smokebot_udp.packed import pack
from smokebot_udp.serialised import serialised
from smokebot_udp.streams.relay.parts import packed_frame
from smokebot_udp.udpros.frame import Frame


def relay_frame(message: Any, max_datagram_size: int) -> Frame:
    return packed_frame(message._md5sum, pack(serialised(message)), max_datagram_size)
