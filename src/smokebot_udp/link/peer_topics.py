# SPDX-License-Identifier: BSD-3-Clause
"""What a transport has of each peer: the exchange of tables (tables.py), and the room of a datagram to it."""
import contextlib
from typing import Dict, FrozenSet, Mapping

import numpy as np

from ..arrays import BoolArray, IntArray, Records, UInt8Array
from ..udpros.datagram import MIN_MAX_DATAGRAM_SIZE
from ..udpros.depacketizer import Arrivals, Depacketizer
from ..udpros.endpoints import BatchSender, path_payload
from ..udpros.packetizer import Packetizer
from .packets import Malformed
from .peer import Peer
from .tables import MAX_TABLE_SIZE, Exchange, Local, Table
from .topics import Outgoing, PeerSender, Publisher, Subscriber

PATH_PERIOD = 5.0
"""How often the room of a datagram is asked for anew: routes change [s]."""


class PeerTopics:
    """The topics of one peer. The link's thread only.

    :param local: this side's topics
    :param sender: of the link's socket
    """

    def __init__(self, peer: Peer, local: Local, sender: BatchSender) -> None:
        self.peer, self.exchange = peer, Exchange(local)
        self._now, self._handshakes = 0.0, peer.handshakes
        self._room, self._room_due = MIN_MAX_DATAGRAM_SIZE, 0.0
        self._sender = sender
        sending = PeerSender(peer, sender.another(sender.tos))
        self._packetizers = {kind: Packetizer(sending, kind, self._room) for kind in Table}
        self._depacketizers = {kind: Depacketizer(kind, _Messages(self, kind), None, max_message_size=MAX_TABLE_SIZE)
                               for kind in Table}
        self.malformed = 0
        """Messages that no correct peer sends."""

    def take(self, kind: int, datagrams: UInt8Array, lengths: IntArray, arrivals: Arrivals, now: float) -> bool:
        """Take datagrams of the peer's messages on tables; returns whether there is such a kind of message."""
        depacketizer = self._depacketizers.get(kind)    # type: ignore[call-overload]
        if depacketizer is None:
            return False
        self._now = now
        depacketizer.take(datagrams, lengths, np.ones(len(lengths), bool), arrivals, now)
        depacketizer.deliver()
        return True

    def take_message(self, kind: Table, data: bytes) -> None:
        """Take a message of the peer."""
        try:
            self.exchange.take(kind, data, self._now)
        except Malformed:
            self.malformed += 1

    def send(self, asked: FrozenSet[int], now: float) -> None:
        """Send the messages that are due, see Exchange.messages. A peer with new keys may have been silent for long."""
        if self.peer.handshakes != self._handshakes:
            self._handshakes = self.peer.handshakes
            self.exchange.renew()
        for kind, data in self.exchange.messages(asked, now):
            packetizer = self._packetizers[kind]
            packetizer.max_datagram_size = self._room
            packetizer.send_message(len(data).to_bytes(4, 'little') + data)

    def serve(self, publishers: Mapping[int, Publisher]) -> None:
        """Connect publishers to the peer as it wants.

        :param publishers: {connection id: publisher}
        """
        for number, publisher in publishers.items():
            connection, wanted = publisher.connection_to(self.peer), number in self.exchange.wants
            if connection is not None and not wanted:
                publisher.remove(self.peer)
            elif connection is None and wanted:
                publisher.add(Outgoing(self.peer, self._sender.another(publisher.tos), number, self._room))
            elif connection is not None:
                connection.follow(self._room, publisher.tos)

    def asked(self, subscribers: Mapping[int, Subscriber]) -> FrozenSet[int]:
        """The connection ids that this side wants of the peer."""
        offers = self.exchange.offers
        wanted = frozenset(number for number, subscriber in subscribers.items() if subscriber.wants(number in offers))
        for number in wanted & offers.keys():
            subscribers[number].connect(self.peer)
        return wanted

    def update_room(self, max_datagram_size: int, now: float, moved: bool = False) -> None:
        """Find out how long a datagram to the peer may be.

        :param max_datagram_size: this side's, with the link's overhead [byte of UDP payload]
        :param moved: whether the peer has another address
        """
        if now < self._room_due and not moved:
            return
        self._room_due = now + PATH_PERIOD
        whole = min(max_datagram_size, self.peer.max_datagram_size)
        with contextlib.suppress(OSError):      # no route now
            whole = min(whole, path_payload(*self.peer.address))
        self._room = max(whole - self.peer.overhead, MIN_MAX_DATAGRAM_SIZE)

    def dropped(self) -> Dict[str, int]:
        """{reason: datagrams or messages} of the exchange; any thread."""
        found: Dict[str, int] = {'malformed table': self.malformed} if self.malformed else {}
        for kind, depacketizer in self._depacketizers.items():
            found.update({'%s: %s' % (kind.name.lower(), reason): count
                          for reason, count in dict(depacketizer.inbox.dropped).items()})
        return found


class _Messages:
    """The Consumer of the Depacketizer of one kind of messages."""
    wants_batches, wants_messages = False, True

    def __init__(self, owner: PeerTopics, kind: Table) -> None:
        self._owner, self._kind = owner, kind

    def take_records(self, records: Records, mask: BoolArray) -> None:
        """Not called."""

    def take_message(self, data: bytes) -> None:
        """See depacketizer.Consumer."""
        self._owner.take_message(self._kind, data)
