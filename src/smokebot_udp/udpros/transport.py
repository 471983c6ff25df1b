# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS over a shared ROS master as the nodes' transport, see smokebot_udp/transport.py."""
import collections
from typing import Any, Callable, Counter, Mapping, Optional, Sequence

import rospy

from .. import version
from ..paths import PathUse
from ..transport import TransportStats, always, nothing
from .datagram import DEFAULT_MAX_DATAGRAM_SIZE
from .depacketizer import Arrived, BatchCallback
from .packetizer import no_limit
from .topics import Publisher, Subscriber


class UdprosTransport:
    """A transport.Transport; the master tells the nodes of each other, and UDPROS checks types and the wire
    format.

    :param max_datagram_size: longest datagram to send and to receive [byte of UDP payload]
    :param receive_buffer: requested from the kernel for each connection [byte]
    :param tos_mask: of the second byte of IP headers, see traffic.mask
    """
    overhead = 0
    own_masters = False

    def __init__(self, max_datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE, receive_buffer: int = 4 << 20,
                 tos_mask: int = 0) -> None:
        self.name: str = rospy.get_name()
        self.tos_mask, self._receive_buffer = tos_mask, receive_buffer
        self.max_datagram_size = self.room = max_datagram_size
        self.on_moved: Callable[[], None] = nothing

    def limit(self, room: int) -> None:
        """See transport.Transport."""
        self.room = min(room, self.max_datagram_size)

    def publisher(self, topic: str, message_class: Any, *, queue_size: int = 10, subscriber_listener: Any = None,
                  carries: str = '', whole: bool = False, tos: int = 0, copied: bool = False) -> Publisher:
        """See transport.Transport; a relay's segments have a checksum of what they carry, so it is not compared."""
        return Publisher(topic, message_class, subscriber_listener, headers=version.headers(), queue_size=queue_size,
                         max_datagram_size=self.max_datagram_size, limit=no_limit if whole else lambda: self.room,
                         tos=tos & self.tos_mask)

    def subscriber(self, topic: str, message_class: Any, callback: Optional[Callable[[Any], None]] = None, *,
                   queue_size: Optional[int] = None, batch_callback: Optional[BatchCallback] = None,
                   arrived: Optional[Arrived] = None, wanted: Callable[[], bool] = always,
                   carries: str = '') -> Subscriber:
        """See transport.Transport."""
        return Subscriber(topic, message_class, callback, queue_size=queue_size, batch_callback=batch_callback,
                          max_datagram_size=self.max_datagram_size, receive_buffer=self._receive_buffer,
                          arrived=arrived, wanted=wanted, headers=version.headers())

    def dropped(self) -> Counter[str]:
        """Nothing: each connection counts its own."""
        return collections.Counter()

    def problem(self) -> Optional[str]:
        """None: a missing master or peer shows in the statuses of streams and connections."""
        return None

    def paths(self, now: float) -> Mapping[str, Sequence[PathUse]]:
        """None: a peer with another address is connected anew."""
        return {}

    def stats(self, now: float) -> Optional[TransportStats]:
        """None, see `problem`."""
        return None

    def close(self) -> None:
        """Nothing: rospy ends its topics with the node."""
