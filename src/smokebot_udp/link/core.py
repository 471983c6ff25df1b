# SPDX-License-Identifier: BSD-3-Clause
"""What the robot's and the operator's side of a link have in common: sessions, and the packets of a batch.

Pure: packets and the time go in, packets, deliveries and events come out. One thread calls a core; a Peer seals in any.

* A packet that is not taken is counted by reason in `dropped`, and changes nothing else.
* Where a probe (PATH_CHALLENGE, PATH_RESPONSE), a copy, or what goes by a second path comes from says nothing about
  where its sender wants to be reached (RFC 9000, 9.1).
* The DATA of a batch is opened session by session. An index that names no session costs no more than its count.
* New keys replace the old ones after the first packet under the new ones; the old ones are taken OLD_KEYS longer.
* Each side sends something at least each 2 KEEP_ALIVE: a message of its own where nothing else was sent meanwhile.
"""
import abc
import collections
import math
from dataclasses import dataclass
from typing import Callable, Counter, Dict, List, Optional, Tuple

import numpy as np

from ..arrays import BoolArray, IntArray, Records, UInt8Array
from ..udpros.datagram import HEADER, IP_UDP_HEADERS
from .control import CHALLENGE_SIZE, COPY, FIRST_TABLE_ID, SECOND, SIZE, Control, marked, message
from .packets import INSTANCE_SIZE, MIN_BODY, OVERHEAD, Kind, Malformed, Packet, parse
from .peer import Delivery, Event, Left, Peer
from .place import Place, place_of
from .session import Session
from .tags import Tags

KEEP_ALIVE = 0.1
"""Between two looks at what was sent. Frequent, so that losses are not taken for silence, and a new address is noticed
soon; an idle link has 6 kbit/s each way [s]."""

MAX_ATTEMPTS = 16
"""At a handshake: an operator takes the answer to any of its last ones, and the robot keeps as many pending sessions of
one instance. A link may take 0.8 s to answer one of the fast attempts, and 4 s later on."""

OLD_KEYS = 10.0
"""How long the keys before the present ones are taken [s]."""

MAX_OLD = 4
"""Sessions of a peer whose keys are still taken."""

SILENT = 60.0
"""A peer that is silent for this long is forgotten [s]."""

CLOSE_COPIES = 3
"""A CLOSE is not acknowledged: it is sent this often."""

CLOSED = 'closed'
"""Reason for which a peer has left that has said so."""

MIN_DATAGRAM_SIZE = 256
"""Who receives less is not taken: the longest packet of the handshake fits [byte of UDP payload]."""

IDLE = 1.0
"""The longest time between two calls of `poll` [s]."""

Random = Callable[[int], bytes]
"""Gives that many random bytes: os.urandom."""


@dataclass
class Entry:
    """A session, and whose it is."""
    session: Session
    name: str
    instance: bytes
    max_datagram_size: int
    place: Place
    """Where the handshake's packets came from."""
    since: float
    ends: float = math.inf
    """When it is forgotten [s]."""
    peer: Optional[Peer] = None
    """None before the keys are confirmed."""


class LinkCore(abc.ABC):
    """One side of a link.

    :param key: of the link, 32 bytes
    :param random: gives random bytes
    :param max_datagram_size: the longest packet to receive, and to send [byte of UDP payload]
    :param name: under which the other side knows this one
    :raises ValueError: if max_datagram_size is less than MIN_DATAGRAM_SIZE
    """

    def __init__(self, key: bytes, random: Random, max_datagram_size: int, name: str) -> None:
        if max_datagram_size < MIN_DATAGRAM_SIZE:
            raise ValueError('a link needs datagrams of at least %d bytes, not %d'
                             % (MIN_DATAGRAM_SIZE, max_datagram_size))
        self.max_datagram_size = max_datagram_size
        self.name = name
        self.instance = random(INSTANCE_SIZE)
        self.dropped: Counter[str] = collections.Counter()
        """Packets that were not taken, by reason."""
        self._key, self._tags, self._random = key, Tags(key), random
        self._entries: Dict[int, Entry] = {}        # by our index
        self._peers: Tuple[Peer, ...] = ()
        self._sent: Dict[int, int] = {}             # {peer's number: packets sent when last looked}
        self._numbers = 0
        self._tick = -math.inf
        self._outputs: List[Tuple[Place, bytes]] = []
        self._events: List[Event] = []

    @property
    def peers(self) -> List[Peer]:
        """The peers there are, by number. Any thread."""
        return list(self._peers)

    def outputs(self) -> List[Tuple[Place, bytes]]:
        """The packets that the core itself wants sent now, once."""
        outputs, self._outputs = self._outputs, []
        return outputs

    def events(self) -> List[Event]:
        """What has happened, once."""
        events, self._events = self._events, []
        return events

    def receive(self, datagrams: UInt8Array, lengths: IntArray, sources: Records, now: float) -> List[Delivery]:
        """Take a batch of packets.

        :param datagrams: (n, slot) uint8
        :param lengths: (n,) int; longer than max_datagram_size if the packet was cut [byte]
        :param sources: (n,) of endpoints.SOCKADDR_IN: who sent them
        :param now: steady time [s]
        """
        whole = lengths <= min(self.max_datagram_size, datagrams.shape[1])
        data = whole & (datagrams[:, 0] == Kind.DATA) & (lengths >= OVERHEAD + MIN_BODY)
        if not data.all():
            self._take_others(datagrams, lengths, sources, whole, np.flatnonzero(~data).tolist(), now)
        rows = np.flatnonzero(data)
        return self._take_data(datagrams, lengths, sources, rows, now) if len(rows) else []

    def _take_others(self, datagrams: UInt8Array, lengths: IntArray, sources: Records, whole: BoolArray,
                     rows: List[int], now: float) -> None:
        """Take the packets that are no DATA, one by one."""
        for row in rows:
            if not whole[row]:
                self.dropped['too long'] += 1
                continue
            try:
                self._on_packet(parse(datagrams[row, :lengths[row]].tobytes()), place_of(sources, row), now)
            except Malformed:
                self.dropped['malformed'] += 1

    def _take_data(self, datagrams: UInt8Array, lengths: IntArray, sources: Records, rows: IntArray,
                   now: float) -> List[Delivery]:
        """Take DATA, session by session."""
        indices = datagrams[rows, 4:8].view('<u4')[:, 0]
        deliveries, unknown = [], []
        for index in set(indices.tolist()):
            entry = self._entries.get(index)    # it may end meanwhile
            if entry is None:
                unknown.append(index)
                continue
            delivery = self._open(entry, datagrams, lengths, sources, rows[indices == index], now)
            if delivery is not None:
                deliveries.append(delivery)
        if unknown:
            strange = np.flatnonzero(np.isin(indices, unknown))
            self.dropped['unknown session'] += len(strange)
            self._on_unknown(int(indices[strange[0]]), place_of(sources, int(rows[strange[0]])), now)
        return deliveries

    def _open(self, entry: Entry, datagrams: UInt8Array, lengths: IntArray, sources: Records, rows: IntArray,
              now: float) -> Optional[Delivery]:
        """Open the packets of one session; returns what is for the topics."""
        opened = entry.session.open(datagrams, lengths, rows, self.dropped)
        if not len(opened.rows) or not self._confirm(entry, now):
            return None
        peer = entry.peer
        assert peer is not None     # confirmed
        peer.heard = now
        numbers = opened.datagrams[:, :4].copy().view('<u4')[:, 0]
        second = marked(opened.datagrams, SECOND)
        if second.any():
            self._on_shared(peer, place_of(sources, int(opened.rows[second][-1])), now)
        aside = ((numbers == Control.PATH_CHALLENGE) | (numbers == Control.PATH_RESPONSE)
                 | marked(opened.datagrams, COPY | SECOND))
        if not aside.all():
            self._on_carried(peer, now)
        if opened.newest >= 0 and not aside[opened.rows == opened.newest].any():
            self._on_place(peer, place_of(sources, opened.newest), int(lengths[opened.newest]), now)
        own = numbers < FIRST_TABLE_ID
        if not own.any():
            return Delivery(peer, opened.datagrams, opened.lengths, opened.rows)
        for at in np.flatnonzero(own).tolist():
            self._take_control(peer, opened.datagrams[at, :opened.lengths[at]].tobytes(),
                               place_of(sources, int(opened.rows[at])), now)
        if own.all() or peer not in self._peers:
            return None
        return Delivery(peer, opened.datagrams[~own], opened.lengths[~own], opened.rows[~own])

    def _take_control(self, peer: Peer, datagram: bytes, source: Place, now: float) -> None:
        if len(datagram) != SIZE:
            self.dropped['malformed'] += 1
            return
        kind = Control(HEADER.unpack_from(datagram)[0])
        if kind == Control.CLOSE:
            if peer in self._peers:     # the first of its copies
                self._leave(peer, CLOSED)
        elif kind != Control.KEEP_ALIVE:
            self._on_path(peer, kind, datagram[HEADER.size:], source, now)

    def poll(self, now: float) -> None:
        """Let time pass: call it at `deadline`, or earlier."""
        if now < self._tick + KEEP_ALIVE:
            return
        self._tick = now
        for index in [index for index, entry in self._entries.items() if entry.ends <= now]:
            del self._entries[index]
        for peer in self._peers:
            if now - peer.heard >= SILENT:
                self._leave(peer, 'silent for %d s' % SILENT)
            elif peer.sent == self._sent.get(peer.number):
                self._send_control(peer, Control.KEEP_ALIVE)
        self._sent = {peer.number: peer.sent for peer in self._peers}

    def deadline(self, now: float) -> float:
        """When to call `poll`, at the latest [s]."""
        return self._tick + KEEP_ALIVE if self._entries else now + IDLE

    def close(self, now: float) -> None:
        """Leave all peers, and tell them."""
        self._leave_all('closed here')

    def set_key(self, key: bytes, now: float) -> None:
        """The key was replaced: who has the former one is not a peer any more [32 bytes, s]."""
        self._leave_all('the key was replaced')
        self._key, self._tags = key, Tags(key)

    def _leave_all(self, reason: str) -> None:
        for peer in self._peers:
            for _ in range(CLOSE_COPIES):
                self._send_control(peer, Control.CLOSE)
            self._leave(peer, reason)
        self._entries.clear()

    def _send(self, place: Place, packet: bytes) -> None:
        self._outputs.append((place, packet))

    def _send_control(self, peer: Peer, kind: Control, body: bytes = bytes(CHALLENGE_SIZE),
                      place: Optional[Place] = None) -> None:
        """Send a message of the core itself to a place of a peer; None: where it is."""
        to, packet = place or peer.place, peer.seal_one(message(kind, body))
        peer.count(to, len(packet) + IP_UDP_HEADERS)
        self._send(to, packet)

    def _new_index(self) -> int:
        """A random one that names no session."""
        while True:
            index = int.from_bytes(self._random(4), 'little')
            if index not in self._entries:
                return index

    def _add_peer(self, entry: Entry, now: float) -> Peer:
        """A new peer with the entry's session."""
        self._numbers += 1
        peer = Peer(self._numbers, self._free_name(entry.name), entry.name, entry.instance,
                    min(entry.max_datagram_size, self.max_datagram_size), entry.place, entry.session, now)
        self._peers += (peer,)
        return peer

    def _free_name(self, told: str) -> str:
        """The name told, with a number if another peer has it."""
        names = {peer.name for peer in self._peers}
        return next(name for name in (told, *('%s #%d' % (told, number) for number in range(2, len(names) + 3)))
                    if name not in names)

    def _change_keys(self, peer: Peer, entry: Entry, now: float) -> None:
        """Give a peer the entry's session; its old ones end soon."""
        old = [other for other in self._entries.values() if other.peer is peer]
        for other in old:
            other.ends = min(other.ends, now + OLD_KEYS)
        for other in sorted(old, key=lambda other: other.since)[:-MAX_OLD]:
            del self._entries[other.session.index]
        peer.use(entry.session)

    def _leave(self, peer: Peer, reason: str) -> None:
        self._peers = tuple(other for other in self._peers if other is not peer)
        for index in [index for index, entry in self._entries.items() if entry.peer is peer]:
            del self._entries[index]
        self._events.append(Left(peer, reason))

    @abc.abstractmethod
    def _on_packet(self, packet: Packet, source: Place, now: float) -> None:
        """A packet of the handshake came."""

    @abc.abstractmethod
    def _on_unknown(self, index: int, source: Place, now: float) -> None:
        """DATA came that names no session; of a batch, the first."""

    @abc.abstractmethod
    def _confirm(self, entry: Entry, now: float) -> bool:
        """Authentic DATA of a session came; returns whether it has a peer now."""

    def _on_carried(self, peer: Peer, now: float) -> None:   # noqa: B027
        """Something other than probes and copies came by a peer's first path; the robot's side does not mind."""

    def _on_shared(self, peer: Peer, source: Place, now: float) -> None:   # noqa: B027
        """Something came from there that a peer sends by a second path; the robot's side does not mind."""

    @abc.abstractmethod
    def _on_place(self, peer: Peer, source: Place, size: int, now: float) -> None:
        """The newest packet of a peer's first path, of `size` bytes and no probe, came from there: its address, or
        another one."""

    @abc.abstractmethod
    def _on_path(self, peer: Peer, kind: Control, body: bytes, source: Place, now: float) -> None:
        """A PATH_CHALLENGE or PATH_RESPONSE came."""
