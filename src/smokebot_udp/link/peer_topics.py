# SPDX-License-Identifier: BSD-3-Clause
"""What a transport has of each peer: the exchange of tables (tables.py), and the room of a datagram to it."""
import contextlib
from typing import Dict, FrozenSet, Mapping

from ..arrays import IntArray, UInt8Array
from ..udpros.datagram import HEADER, Op
from ..udpros.endpoints import BatchSender, path_payload
from .core import MIN_DATAGRAM_SIZE
from .packets import OVERHEAD, Malformed
from .peer import Peer
from .place import address_of
from .tables import Exchange, Local, Table
from .topics import Outgoing, PeerSender, Publisher, Subscriber

PATH_PERIOD = 5.0
"""How often the room of a datagram is asked for anew: routes change [s]."""

LIVELY = 2.0
"""A peer that was heard within this time is told again soon what it has not acknowledged [s]."""

KINDS = frozenset(map(int, Table))


class PeerTopics:
    """The topics of one peer. The link's thread only.

    :param local: this side's topics
    :param sender: of the link's socket
    """

    def __init__(self, peer: Peer, local: Local, sender: BatchSender) -> None:
        self.peer, self.exchange = peer, Exchange(local)
        self.asked: FrozenSet[int] = frozenset()
        """The connection ids that this side has asked the peer for."""
        self._socket = sender
        self._sender, self._handshakes = PeerSender(peer, sender.another(sender.tos)), peer.handshakes
        self._room, self._room_due, self._second = MIN_DATAGRAM_SIZE - OVERHEAD, 0.0, peer.second
        self.malformed = 0
        """Datagrams of tables that no correct peer sends."""

    def take(self, kind: int, datagrams: UInt8Array, lengths: IntArray, now: float) -> bool:
        """Take datagrams of the peer's tables; returns whether they said something new."""
        changed = False
        for datagram, length in zip(datagrams, lengths.tolist()):
            try:
                changed |= self.exchange.take(kind, datagram[HEADER.size:length].tobytes(), now)
            except Malformed:
                self.malformed += 1
        return changed

    def send(self, now: float) -> None:
        """Send the messages that are due, see Exchange.messages. A peer with new keys may have been silent for long."""
        if self.peer.handshakes != self._handshakes:
            self._handshakes = self.peer.handshakes
            self.exchange.renew()
        alive = now - self.peer.heard < LIVELY
        for kind, data in self.exchange.messages(self.asked, self._room - HEADER.size, alive, now):
            self._sender.send_one(HEADER.pack(kind, Op.DATA0, 1, 1), data)

    def serve(self, publishers: Mapping[int, Publisher]) -> None:
        """Connect publishers to the peer as it wants.

        :param publishers: {connection id: publisher}
        """
        for number, publisher in publishers.items():
            connection, wanted = publisher.connection_to(self.peer), number in self.exchange.wants
            if connection is not None and not wanted:
                publisher.remove(self.peer)
            elif connection is None and wanted:
                publisher.add(Outgoing(self.peer, self._socket.another(publisher.tos), number, self._room,
                                       publisher.limit, publisher.copied))
            elif connection is not None:
                connection.follow(self._room, publisher.tos)

    def ask(self, subscribers: Mapping[int, Subscriber]) -> None:
        """Find out what this side wants of the peer; `send` says so."""
        offers = self.exchange.offers
        wanted = frozenset(number for number, subscriber in subscribers.items() if subscriber.wants(number in offers))
        for number in wanted & offers:
            subscribers[number].connect(self.peer)
        self.asked = wanted

    def update_room(self, max_datagram_size: int, now: float, moved: bool = False) -> None:
        """Find out how long a datagram to the peer may be.

        :param max_datagram_size: this side's, with the link's overhead [byte of UDP payload]
        :param moved: whether the peer has another address
        """
        if now < self._room_due and not moved and self.peer.second == self._second:
            return
        self._second = self.peer.second
        self._room_due = now + PATH_PERIOD
        whole = min(max_datagram_size, self.peer.max_datagram_size)
        places = [self.peer.place, *([] if self.peer.second is None else [self.peer.second])]
        for place in places:
            with contextlib.suppress(OSError):      # no route now
                whole = min(whole, path_payload(*address_of(place), place.via))
        self._room = max(whole, MIN_DATAGRAM_SIZE) - OVERHEAD

    def dropped(self) -> Dict[str, int]:
        """{reason: datagrams} of the exchange; any thread."""
        return {'malformed table': self.malformed} if self.malformed else {}
