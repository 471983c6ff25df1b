# SPDX-License-Identifier: BSD-3-Clause
"""The other side of a link, and what happens to it.

A Peer is one run (instance) of the other side's process. It outlives sessions and addresses: new keys and a new address
change it in place. Another run is another Peer, with a higher number.
"""
import collections
import math
import threading
from dataclasses import dataclass
from typing import Counter, Dict, Optional, Tuple, Union

import numpy as np

from ..arrays import IntArray, UInt8Array
from ..newest import Newest
from .packets import Reason
from .place import Address, Place, address_of, interface_of, path_of
from .session import Session

Carried = Dict[Tuple[str, str], int]
"""{(host, interface): bytes}."""

MAX_HOSTS = 8
"""Hosts of a peer, by interface, whose bytes are remembered."""


class Peer:
    """One run of the other side.

    :param number: higher for a later one
    :param name: which no other peer of this side has
    :param told: the name that it has told
    :param instance: 16 bytes that it chose at its start
    :param max_datagram_size: the longest packet that both sides take [byte of UDP payload]
    """

    def __init__(self, number: int, name: str, told: str, instance: bytes, max_datagram_size: int, place: Place,
                 session: Session, now: float) -> None:
        self.number, self.name, self.told = number, name, told
        self.instance, self.max_datagram_size = instance, max_datagram_size
        self.place = place
        """Where packets for it go."""
        self.second: Optional[Place] = None
        """Another place where it receives now; None: none is known."""
        self.second_heard = self.second_used = -math.inf
        """When it was heard from there, and when something but copies went there [s]."""
        self.first_heard, self.is_quiet = now, False
        """When it was heard from `place`, and whether it is heard from `second` only: of an operator [s]."""
        self.heard = now
        """When its latest authentic packet came [s]."""
        self.handshakes = 1
        """How often it was given keys."""
        self.round_trip: Optional[float] = None
        """Round-trip time of the latest handshake, including the other side's reaction [s]."""
        self._session = session
        self._sealed = 0    # by former sessions
        self._carried: Newest[Place, int] = Newest(MAX_HOSTS)
        self._counting = threading.Lock()

    @property
    def address(self) -> Address:
        """Host and port."""
        return address_of(self.place)

    @property
    def session(self) -> Session:
        """The session whose keys seal packets for it."""
        return self._session

    @property
    def sent(self) -> int:
        """Packets sealed for it."""
        return self._sealed + self._session.sent

    @property
    def carried(self) -> Carried:
        """What was sent to it, IP and UDP headers included; any thread."""
        with self._counting:
            carried = dict(self._carried)
        found: Counter[Tuple[str, str]] = collections.Counter()
        for place, size in carried.items():     # interfaces that are gone have no name
            found[address_of(place)[0], interface_of(place)] += size
        return found

    def count(self, place: Place, size: int) -> None:
        """Count what was sent to it; any thread.

        :param size: IP and UDP headers included [byte]
        """
        path = path_of(place)
        with self._counting:
            self._carried[path] = self._carried.get(path, 0) + size

    def use(self, session: Session) -> None:
        """Seal under new keys from now on."""
        self._sealed += self._session.sent
        self._session = session
        self.handshakes += 1

    def seal(self, datagrams: UInt8Array) -> UInt8Array:
        """Packets ready to be sent, (n, size) to (n, size + OVERHEAD) uint8, C-contiguous. Any thread."""
        return self._session.seal(datagrams)

    def seal_one(self, *parts: bytes) -> bytes:
        """The packet of one datagram, given in parts. Any thread."""
        packet: bytes = self._session.seal(np.frombuffer(b''.join(parts), np.uint8)[np.newaxis]).tobytes()
        return packet

    def __repr__(self) -> str:
        return 'Peer(%r, number %d, at %s:%d)' % (self.name, self.number, *self.address)


@dataclass
class Delivery:
    """The datagrams of one peer in a batch, in their order, without the core's own messages.

    While a peer changes its keys, there may be one for each session.
    """
    peer: Peer
    datagrams: UInt8Array
    """(k, slot - OVERHEAD) uint8, C-contiguous: a UDPROS datagram, header first, and zeros."""
    lengths: IntArray
    """(k,) int64 [byte]."""
    rows: IntArray
    """(k,) int64: the rows of the batch given."""


@dataclass
class Joined:
    """There is a new peer."""
    peer: Peer


@dataclass
class Left:
    """A peer is no more."""
    peer: Peer
    reason: str


@dataclass
class Moved:
    """A peer has another address."""
    peer: Peer
    address: Address


@dataclass
class Quiet:
    """A peer is heard over its second path only."""
    peer: Peer


@dataclass
class Refused:
    """No peer came of a handshake."""
    reason: Reason
    sentence: str


Event = Union[Joined, Left, Moved, Quiet, Refused]
