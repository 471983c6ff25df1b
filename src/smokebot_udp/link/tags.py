# SPDX-License-Identifier: BSD-3-Clause
"""The tags of a handshake's packets: who has the key of the link has made them.

They are MACs (keyed BLAKE2s), as mac1 of WireGuard's handshake. One costs a hundredth of the key exchange, and is
checked before anything else is done for a packet.
"""
import hashlib
import hmac
from typing import TypeVar, Union

from .packets import TAG_SIZE, Cookie, Hello, Init

PURPOSE = b'smokebot_udp link: tags of handshakes'
"""The key of the MACs follows from the link's: the handshake itself uses that for something else."""

TAG_AT = {Hello: 12, Cookie: 28, Init: 32}
"""Place of the tag in a packet."""

Tagged = TypeVar('Tagged', Hello, Cookie, Init)


class Tags:
    """Makes and checks tags.

    :param key: of the link, 32 bytes
    """

    def __init__(self, key: bytes) -> None:
        self._key = hashlib.blake2s(PURPOSE, key=key).digest()

    def tagged(self, packet: Tagged) -> Tagged:
        """The packet with its tag."""
        return packet._replace(tag=self._tag(packet))

    def is_right(self, packet: Tagged) -> bool:
        """Whether the tag is that of the packet."""
        return hmac.compare_digest(packet.tag, self._tag(packet))

    def _tag(self, packet: Tagged) -> bytes:
        """The tag: a MAC of the packet without the tag itself and the release, which older sides do not know."""
        datagram, at = _without_release(packet).pack(), TAG_AT[type(packet)]
        others = datagram[:at] + datagram[at + TAG_SIZE:]
        return hashlib.blake2s(others, digest_size=TAG_SIZE, key=self._key).digest()


def _without_release(packet: Union[Cookie, Hello, Init]) -> Union[Cookie, Hello, Init]:
    return packet._replace(release='') if isinstance(packet, Hello) else packet
