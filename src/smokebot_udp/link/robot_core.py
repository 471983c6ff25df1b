# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of a link: it answers operators, and never speaks first.

Rules, in the order in which a stranger meets them; each has its tests in test_robot_core or test_robot_peers:

1. HELLO is answered by a COOKIE, or refused: another version, another key. Nothing is kept.
2. INIT is dropped unless its cookie is this robot's for this address and nonce, and refused if its tag is wrong:
   another key.
3. An ephemeral that was taken within its cookie's life is dropped. Of the others, each host has INIT_BURST at once, and
   then one each INIT_PERIOD: what others send in an operator's name does not take its share.
4. Only now the handshake is read, and X25519 computed.
5. A stranger is refused if there are MAX_PEERS, none of which gives up its place (rule 10).
6. The session is pending for PENDING: at most MAX_ATTEMPTS of one instance, MAX_PENDING in all; the oldest goes.
7. The first authentic DATA makes it the peer's, and ends the pending others of the same instance. The same instance
   is the same peer with new keys.
8. A peer whose newest packet, other than a probe, comes from another address is challenged there (path.py), and has
   moved when it answers before it has left that address again. Probes are answered where they come from, and a peer
   is challenged there, too: it is followed at once to an address that it has proved. MAX_PATHS are remembered. One
    that is proved, and from which probes come that were sent after it was left, is the second path.
9. Names are unique, since what operators report and get goes by name: a later peer of a name gets ' #2' after it.
10. A peer is forgotten after 60 s of silence, at its CLOSE, or when a later one of its name is there and it is silent
    for REPLACED. When another one needs its place, it is forgotten if it is silent for YIELDS.
11. DATA of a session that is not known is answered by UNKNOWN, at most UNKNOWN_BURST at once, then 1 / UNKNOWN_PERIOD.
12. A peer from whose address nothing comes for QUIET, while probes come from its other one, is quiet: what may go by
    either path goes by the second one only. The peer itself leaves a silent address later (robot_paths.py).
"""
from typing import Dict, List, Optional

from ..budget import Budget
from ..newest import Newest
from ..version import OURS, Software, difference
from .control import CHALLENGE_SIZE, SIZE, Control
from .cookie import LIFETIME, CookieJar
from .core import MAX_ATTEMPTS, MIN_DATAGRAM_SIZE, Entry, LinkCore, Random
from .noise import Forged, Responder
from .packets import (
    EPHEMERAL_SIZE,
    OVERHEAD,
    VERSION,
    Accept,
    Cookie,
    Hello,
    Init,
    Packet,
    Reason,
    Refuse,
    Reply,
    Request,
    Suite,
    Unknown,
    prologue,
)
from .path import PathCheck
from .peer import Joined, Moved, Peer, Quiet, Refused
from .place import Place, address_of
from .replay import HandshakeMemory
from .robot_paths import ALIVE, MAX_PATHS
from .session import Session

MAX_PEERS = 8

MAX_HOSTS = 256
"""Whose budgets are remembered, so that one host cannot take the others' share."""

INIT_BURST, INIT_PERIOD = 64, 0.02
"""INITs of one host: eight operators behind one address, all of them beginning anew [s]."""

PENDING = 5.0
"""How long an accepted handshake waits for its first DATA [s]."""

MAX_PENDING = 64

REPLACED, YIELDS = 1.0, 10.0
"""An operator sends something ten times a second [s]."""

UNKNOWN_BURST, UNKNOWN_PERIOD = 16, 0.02
"""[s]"""

EVENT_PERIOD = 10.0
"""Between two events of one reason to refuse [s]."""

QUIET = 0.1
"""An operator that gets images sends 30 datagrams a second, others a probe and a report each 0.1 s [s]."""

VERSION_PERIOD = 3600.0
"""Between two events of the version of one host: that lasts until somebody updates a machine [s]."""


class RobotCore(LinkCore):
    """The robot's side. See LinkCore for the arguments; `suite`: the cipher of the link."""

    def __init__(self, key: bytes, random: Random, max_datagram_size: int, name: str,
                 suite: Suite = Suite.AESGCM) -> None:
        super().__init__(key, random, max_datagram_size, name)
        self._suite = suite
        self._cookies = CookieJar(random)
        self._taken = HandshakeMemory(2 * LIFETIME)
        self._inits: Newest[int, Budget] = Newest(MAX_HOSTS)        # by the IPv4 address of the host, as below
        self._hints = Budget(UNKNOWN_BURST, UNKNOWN_PERIOD)
        self._checks: Dict[int, Newest[Place, PathCheck]] = {}      # by the peer's number
        self._told: Dict[Reason, float] = {}        # when a refusal became an event
        self._versions: Newest[int, Budget] = Newest(MAX_HOSTS)

    def _on_packet(self, packet: Packet, source: Place, now: float) -> None:
        if isinstance(packet, Hello):
            self._on_hello(packet, source, now)
        elif isinstance(packet, Init):
            self._on_init(packet, source, now)
        else:
            self.dropped['a robot\'s packet'] += 1

    def _on_hello(self, hello: Hello, source: Place, now: float) -> None:
        if hello.version != VERSION:
            self._refuse_version(hello, source, now)
        elif not self._tags.is_right(hello):
            self._refuse(Reason.WRONG_KEY, source, hello.nonce, now)
        else:
            cookie = Cookie(VERSION, self._suite, hello.nonce, self._cookies.make(source, hello.nonce, now))
            self._send(source, self._tags.tagged(cookie).pack())

    def _refuse_version(self, hello: Hello, source: Place, now: float) -> None:
        """Who names its release is told this one's: others know no REFUSE that is longer."""
        refuse = Refuse(VERSION, Reason.VERSION, hello.nonce, OURS.release if hello.release else '')
        text = difference('it', Software(hello.version, hello.release), 'this robot', OURS)
        self._send_refusal(refuse, source, text, now, self._versions)

    def _refuse(self, reason: Reason, source: Place, nonce: int, now: float) -> None:
        self._send_refusal(Refuse(VERSION, reason, nonce), source, TO_US[reason], now)

    def _send_refusal(self, refuse: Refuse, source: Place, text: str, now: float,
                      budgets: Optional[Newest[int, Budget]] = None) -> None:
        """:param budgets: by host; a refusal of each may become an event once in VERSION_PERIOD"""
        reason = Reason(refuse.reason)
        self.dropped[REFUSED[reason]] += 1
        self._send(source, refuse.pack())
        if (now - self._told.get(reason, -EVENT_PERIOD) >= EVENT_PERIOD
                and (budgets is None or budgets.of(source[0], lambda: Budget(1, VERSION_PERIOD)).take(now))):
            self._told[reason] = now
            self._events.append(Refused(reason, 'refused %s:%d: %s' % (*address_of(source), text)))

    def _on_init(self, init: Init, source: Place, now: float) -> None:
        if (init.version, init.suite) != (VERSION, self._suite):
            self.dropped['another version or cipher'] += 1
        elif not self._cookies.is_valid(init.cookie, source, init.nonce, now):
            self.dropped['wrong cookie'] += 1
        elif not self._tags.is_right(init):
            self._refuse(Reason.WRONG_KEY, source, init.nonce, now)
        elif init.message[:EPHEMERAL_SIZE] in self._taken:
            self.dropped['replayed handshake'] += 1
        elif not self._inits.of(source[0], lambda: Budget(INIT_BURST, INIT_PERIOD)).take(now):
            self.dropped['too many handshakes'] += 1
        else:
            self._answer(init, source, now)

    def _answer(self, init: Init, source: Place, now: float) -> None:
        """Rules 4 to 6."""
        noise = Responder(self._key, self._suite, prologue(init))
        try:
            request = Request.parse(noise.read(init.message))
            self._taken.add(init.message[:EPHEMERAL_SIZE], now)
            if not self._is_acceptable(request, source, init.nonce, now):
                return
            index = self._new_index()
            reply = Reply(index, self.instance, self.max_datagram_size, self.name)
            answer = noise.write(reply.pack(), self._random(EPHEMERAL_SIZE))
        except Forged:      # by who has the key
            self.dropped['malformed'] += 1
            return
        keys = noise.keys()
        self._accept(Session(index, init.sender, self._suite, keys.responder, keys.initiator), request, answer, source,
                     now)

    def _is_acceptable(self, request: Request, source: Place, nonce: int, now: float) -> bool:
        """Whether there is room for this operator; refuses it otherwise."""
        if request.max_datagram_size < MIN_DATAGRAM_SIZE:
            self.dropped['malformed'] += 1
            return False
        known = any(peer.instance == request.instance for peer in self._peers)
        if not known and len(self._peers) >= MAX_PEERS and self._who_leaves(request.name, now) is None:
            self._refuse(Reason.FULL, source, nonce, now)
            return False
        return True

    def _accept(self, session: Session, request: Request, answer: bytes, source: Place, now: float) -> None:
        """Rule 6."""
        pending = [entry for entry in self._entries.values() if entry.peer is None]
        own = [entry for entry in pending if entry.instance == request.instance]
        for entries, room in ((own, MAX_ATTEMPTS), (pending, MAX_PENDING)):
            if len(entries) >= room:
                self._entries.pop(entries[0].session.index, None)
        self._entries[session.index] = Entry(session, request.name, request.instance, request.max_datagram_size,
                                             source, now, now + PENDING)
        self._send(source, Accept(VERSION, self._suite, session.their_index, answer).pack())

    def _confirm(self, entry: Entry, now: float) -> bool:
        """Rule 7."""
        if entry.peer is not None:
            return True
        peer = next((peer for peer in self._peers if peer.instance == entry.instance), None)
        if peer is None and not self._make_room(entry, now):
            del self._entries[entry.session.index]
            self.dropped['full'] += 1
            return False
        for index in [index for index, other in self._entries.items()
                      if other.peer is None and other is not entry and other.instance == entry.instance]:
            del self._entries[index]
        if peer is None:
            peer = self._add_peer(entry, now)
            self._events.append(Joined(peer))
        else:
            self._change_keys(peer, entry, now)
            self._move(peer, entry.place, now)
        entry.peer, entry.ends, peer.round_trip = peer, float('inf'), now - entry.since
        self._send_control(peer, Control.KEEP_ALIVE)    # so that the operator knows
        return True

    def _make_room(self, entry: Entry, now: float) -> bool:
        """Rule 10, when a peer comes; returns whether there is room for it."""
        for peer in self._peers:
            if peer.told == entry.name and now - peer.heard >= REPLACED:
                self._leave(peer, 'replaced by a later one of its name')
        if len(self._peers) >= MAX_PEERS:
            leaves = self._who_leaves(entry.name, now)
            if leaves is None:
                return False
            self._leave(leaves, 'silent for %d s, and its place was needed' % YIELDS)
        return True

    def _who_leaves(self, name: str, now: float) -> Optional[Peer]:
        """Who gives up its place to a peer of this name, where there are MAX_PEERS."""
        silent = min(self._peers, key=lambda peer: peer.heard)
        if now - silent.heard >= YIELDS:
            return silent
        return next((peer for peer in self._peers if peer.told == name and now - peer.heard >= REPLACED), None)

    def poll(self, now: float) -> None:
        """See LinkCore."""
        super().poll(now)
        latest = {peer.told: peer.number for peer in self._peers}
        for peer in self._peers:
            if peer.number < latest[peer.told] and now - peer.heard >= REPLACED:
                self._leave(peer, 'replaced by a later one of its name')
        self._checks = {peer.number: self._checks[peer.number] for peer in self._peers if peer.number in self._checks}
        for peer in self._peers:
            second = next((check for check in self._checks_of(peer) if check.place != peer.place and check.holds(now)
                           and now - check.probed < ALIVE and check.probed > check.left), None)
            peer.second, peer.second_heard = (None, now) if second is None else (second.place, second.probed)
            self._find_quiet(peer, now)

    def _find_quiet(self, peer: Peer, now: float) -> None:
        """Rule 12."""
        was_quiet = peer.is_quiet
        peer.is_quiet = (peer.second is not None and now - peer.first_heard >= QUIET
                         and peer.second_heard > peer.first_heard)
        if peer.is_quiet and not was_quiet:
            self._events.append(Quiet(peer))

    def deadline(self, now: float) -> float:
        """See LinkCore."""
        quiet = [peer.first_heard + QUIET for peer in self._peers if peer.second is not None]
        return min([super().deadline(now), *(time for time in quiet if time > now)])

    def _check(self, peer: Peer, place: Place) -> PathCheck:
        """The check of a peer's other address."""
        checks = self._checks.setdefault(peer.number, Newest(MAX_PATHS))
        return checks.of(place, lambda: PathCheck(place, self._random(CHALLENGE_SIZE)))

    def _checks_of(self, peer: Peer) -> List[PathCheck]:
        checks = self._checks.get(peer.number)
        return [] if checks is None else list(checks.values())

    def _challenge(self, peer: Peer, check: PathCheck, now: float) -> None:
        if check.may_send(SIZE + OVERHEAD, now):
            self._send_control(peer, Control.PATH_CHALLENGE, check.challenge, check.place)

    def _on_place(self, peer: Peer, source: Place, size: int, now: float) -> None:
        """Rule 8."""
        if source == peer.place:
            peer.first_heard = now
            for check in self._checks_of(peer):
                check.proposed &= not check.has_left(now)
            return
        check = self._check(peer, source)
        check.came(size, now)
        if check.holds(now):
            self._move(peer, source, now)
        else:
            self._challenge(peer, check, now)

    def _on_path(self, peer: Peer, kind: Control, body: bytes, source: Place, now: float) -> None:
        """Rule 8."""
        if source == peer.place:
            peer.first_heard = now
        if kind == Control.PATH_CHALLENGE:
            self._answer_probe(peer, body, source, now)
            return
        check = next((check for check in self._checks_of(peer) if check.is_proof(source, body)), None)
        if check is not None:
            check.proved = now
            if check.proposed:
                self._move(peer, source, now)

    def _answer_probe(self, peer: Peer, body: bytes, source: Place, now: float) -> None:
        """Rule 8."""
        if source != peer.place:
            check = self._check(peer, source)
            check.came(SIZE + OVERHEAD, now, proposes=False)
            if check.wants_proof(now):
                self._challenge(peer, check, now)
            if not check.may_answer(SIZE + OVERHEAD, now):
                return
        self._send_control(peer, Control.PATH_RESPONSE, body, source)

    def _move(self, peer: Peer, place: Place, now: float) -> None:
        """Its address before is proved as well."""
        if peer.place != place:
            before = self._check(peer, peer.place)
            before.proved = before.left = now
            self._check(peer, place).proposed = False
            peer.place, peer.first_heard = place, now
            if peer.second == place:
                peer.second = None
            self._events.append(Moved(peer, peer.address))

    def _on_unknown(self, index: int, source: Place, now: float) -> None:
        """Rule 11."""
        if self._hints.take(now):
            self._send(source, Unknown(VERSION, index).pack())


REFUSED = {reason: 'refused: %s' % reason.name.lower().replace('_', ' ') for reason in Reason}

TO_US = {
    Reason.WRONG_KEY: 'it has another key',
    Reason.FULL: 'there are %d operators already' % MAX_PEERS,
}
"""Why an operator was refused, for the robot's log; of another version: see version.difference."""
