# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of a link: it speaks first, and goes on until the robot answers.

Rules; each has a test in test_operator_core:

1. Without a robot: HELLO at once, then INIT at once with each new cookie. Both are repeated after FIRST_RETRY, after
   FAST_FOR ever more slowly, up to LAST_RETRY, jittered. Each INIT_PER_HELLO-th INIT goes with a HELLO: the cookie may
   be of no use any more.
2. Each INIT has a fresh ephemeral and index. The answer to any of the last MAX_ATTEMPTS is taken; the first one ends
   the handshake.
3. An answer that does not return the nonce or an attempt's index, or is not authentic, is counted and changes nothing.
   A COOKIE is taken from the robot's addresses only, one for each HELLO, and with the right tag. A REFUSE comes from
   them, too.
4. The robot is the peer from ACCEPT on. A keep-alive is repeated each CONFIRM until the robot sends DATA.
5. The same instance is the same peer with new keys. Another one: the robot was restarted, the old peer has left.
6. Silence of SILENCE begins a handshake beside the session, which goes on if the robot is heard again. UNKNOWN shortens
   it to HINTED_SILENCE; a forged one cannot do more, since a robot that is heard is not asked. New keys that the robot
   does not use in this time are silence, too, even if it is heard under the old ones: it may have lost the handshake.
7. A session is renewed after REKEY_AFTER, or REKEY_MESSAGES.
8. A refusal is told, and the next HELLO waits for REFUSED_RETRY. It does not end the attempts, and is taken once for
   each: who sees the link's traffic can forge or repeat it.
9. Silence of 60 s, or a CLOSE, ends the peer. Handshakes go on.
10. Each HELLO goes to all addresses of the robot, each INIT to the one whose COOKIE came last. Then robot_paths.py says
    which one is used, and which other one gets copies. The robot's challenges are answered on the path that they came
    by.
"""
import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

from ..arrays import IntArray, Records, UInt8Array
from ..newest import Newest
from ..version import OURS, Software, difference
from .control import CHALLENGE_SIZE, Control
from .core import MAX_ATTEMPTS, MIN_DATAGRAM_SIZE, Entry, LinkCore, Random
from .noise import Forged, Initiator
from .packets import (
    EPHEMERAL_SIZE,
    SENTENCES,
    VERSION,
    Accept,
    Cookie,
    Hello,
    Init,
    Malformed,
    Packet,
    Reason,
    Refuse,
    Reply,
    Request,
    Suite,
    Unknown,
    prologue,
)
from .peer import Delivery, Joined, Moved, Peer, Refused
from .place import Place, address_of
from .robot_paths import MAX_PATHS, Path, RobotPaths
from .session import Session

FIRST_RETRY, FAST_FOR, LAST_RETRY, RETRY_GROWTH, JITTER = 0.05, 5.0, 0.25, 1.3, 0.2
"""Time to the next attempt, and for how long; then the longest, the factor from one to the next, and its random part
[s, s, s, 1, 1]. At 80 % loss each way 0.04 of the attempts succeed. A robot that is not there is asked with 12 kbit/s,
and then with 2."""

REFUSED_RETRY = 0.5
"""Time to the next attempt after a refusal [s]."""

SUITES = frozenset(Suite)
"""Ciphers that a robot may choose."""

INIT_PER_HELLO = 4

CONFIRM, CONFIRM_FOR = 0.05, 0.5
"""Between two keep-alives for a robot that has not sent DATA yet, and for how long [s]."""

SILENCE, HINTED_SILENCE = 0.5, 0.25
"""[s]"""

REKEY_AFTER = 3600.0
"""[s]"""

REKEY_MESSAGES = 1 << 60

TELL_SILENCE = 1.0
"""Silence of the robot that is a problem [s]."""

REFUSAL_COUNTS = 3.0
"""How long a refusal is the problem [s]."""


@dataclass
class Attempt:
    """An INIT that was sent."""
    noise: Initiator
    suite: Suite
    place: Place
    sent: float


NO_ANSWER = 'no answer from '
"""The problem with a silent robot begins with it."""


class Handshake:
    """One handshake: its nonce, the cookie, and when to try again.

    :param silence: whether it was begun since the robot is silent
    """

    def __init__(self, nonce: int, now: float, silence: bool) -> None:
        self.nonce, self.silence = nonce, silence
        self.cookie: Optional[Cookie] = None
        self.asked = 0
        """HELLOs without an answer."""
        self.inits = 0
        self.place: Optional[Place] = None
        """Whence the cookie came."""
        self.due = now
        self._since = now           # of the fast attempts
        self._interval = FIRST_RETRY
        self._refused = False       # since the last attempt

    def take(self, cookie: Cookie, place: Place, now: float) -> None:
        """A new cookie: the attempts begin anew."""
        self.cookie, self.place, self.inits, self._interval, self._since = cookie, place, 0, FIRST_RETRY, now

    def refused(self, now: float) -> None:
        """Begin again, later. Further refusals of one attempt change nothing: repeated ones would end the attempts."""
        if not self._refused:
            self.cookie, self.due, self._refused = None, now + REFUSED_RETRY, True

    def wait(self, now: float, jitter: float) -> None:
        """Set the time of the next attempt; jitter in [-1, 1]."""
        self.due, self._refused = now + self._interval * (1 + JITTER * jitter), False
        if now - self._since >= FAST_FOR:
            self._interval = min(LAST_RETRY, self._interval * RETRY_GROWTH)


class OperatorCore(LinkCore):
    """The operator's side. See LinkCore for the arguments. It begins with `set_addresses`."""

    def __init__(self, key: bytes, random: Random, max_datagram_size: int, name: str) -> None:
        super().__init__(key, random, max_datagram_size, name)
        self.problem: Optional[str] = 'the robot\'s address is not known'
        """Why there is no robot: one sentence; None if there is one."""
        self._places: Tuple[Place, ...] = ()
        self._paths: Optional[RobotPaths] = None        # None: no robot, or it has one address
        self._handshake: Optional[Handshake] = None
        self._attempts: Newest[int, Attempt] = Newest(MAX_ATTEMPTS)     # by our index
        self._hinted = False
        self._refusal: Tuple[float, str] = (-math.inf, '')      # when, and why; also answers from another address
        self._entry: Optional[Entry] = None         # under which is sent
        self._confirmed = False         # whether the robot has used it
        self._confirm_at = math.inf     # if not: when to send another keep-alive

    @property
    def robot(self) -> Optional[Peer]:
        """The peer, if there is one."""
        return self._peers[0] if self._peers else None

    @property
    def paths(self) -> List[Path]:
        """Those to the robot, in order of preference; empty: it has one address. Any thread."""
        paths = self._paths
        return [] if paths is None else paths.paths

    def set_places(self, places: Sequence[Place], now: float) -> None:
        """Where the robot is from now on.

        :param places: in order of preference; equal ones count once
        :param now: [s]
        """
        places = tuple(dict.fromkeys(places))[:MAX_PATHS]
        if places != self._places:
            self._places = places
            robot = self.robot
            if robot is not None and robot.place in places:
                self._find_paths(robot, now)
            else:
                self._begin(now, silence=False)
        self._update_problem(now)

    def _place_of(self, source: Place) -> Optional[Place]:
        """From which of the robot's places a packet comes; None: from elsewhere."""
        return next((place for place in self._places if place.covers(source)), None)

    def _find_paths(self, robot: Peer, now: float) -> None:
        several = len(self._places) > 1 and robot.place in self._places
        self._paths = RobotPaths(self._places, robot.place, now) if several else None
        robot.second = None

    def receive(self, datagrams: UInt8Array, lengths: IntArray, sources: Records, now: float) -> List[Delivery]:
        """See LinkCore."""
        deliveries = super().receive(datagrams, lengths, sources, now)
        self._update_problem(now)
        return deliveries

    def poll(self, now: float) -> None:
        """See LinkCore."""
        super().poll(now)
        robot = self.robot
        if robot is not None and self._paths is not None:
            self._follow(robot, self._paths, now)
        if self._handshake is None and self._places:
            if robot is None or now >= self._silent_at(robot):
                self._begin(now, silence=True)
            elif self._is_old(now):
                self._begin(now, silence=False)
        if self._handshake is not None and now >= self._handshake.due:
            self._try(self._handshake, now)
        if now >= self._confirm_at:
            self._ask_for_data(now)
        self._update_problem(now)

    def _follow(self, robot: Peer, paths: RobotPaths, now: float) -> None:
        """Rule 10."""
        for path in paths.due(now):
            challenge = self._random(CHALLENGE_SIZE)
            path.ask(challenge, now)
            self._send_control(robot, Control.PATH_CHALLENGE, challenge, path.place)
        if paths.choose(now):
            robot.place = paths.used
            self._send_control(robot, Control.KEEP_ALIVE)   # the robot follows it
            self._events.append(Moved(robot, robot.address))
        robot.second = paths.second(now)

    def _silent_at(self, robot: Peer) -> float:
        """When the robot counts as silent, if it is not heard again."""
        entry = self._entry
        heard = robot.heard if entry is None or self._confirmed else entry.since
        return heard + (HINTED_SILENCE if self._hinted else SILENCE)

    def _is_old(self, now: float) -> bool:
        entry = self._entry
        return entry is not None and (now - entry.since >= REKEY_AFTER or entry.session.sent >= REKEY_MESSAGES)

    def deadline(self, now: float) -> float:
        """See LinkCore."""
        times = [super().deadline(now), self._confirm_at]
        if self._handshake is not None:
            times.append(self._handshake.due)
        elif self.robot is not None:
            times.append(self._silent_at(self.robot))
        if self._paths is not None:
            times.append(self._paths.deadline(now))
        return min(times)

    def close(self, now: float) -> None:
        """See LinkCore."""
        super().close(now)
        self._places, self._handshake = (), None
        self._attempts.clear()

    def set_key(self, key: bytes, now: float) -> None:
        """See LinkCore."""
        super().set_key(key, now)
        self._attempts.clear()
        self._refusal = -math.inf, ''
        if self._places:
            self._begin(now, silence=False)

    def _begin(self, now: float, silence: bool) -> None:
        """Begin a handshake; answers to the attempts of the one before are still taken."""
        self._handshake = Handshake(int.from_bytes(self._random(8), 'little'), now, silence)
        self._try(self._handshake, now)

    def _try(self, handshake: Handshake, now: float) -> None:
        """Rule 1."""
        if handshake.cookie is None or handshake.inits % INIT_PER_HELLO == INIT_PER_HELLO - 1:
            for place in self._places:
                self._send(place, self._hello(handshake.nonce).pack())
                handshake.asked += 1
        if handshake.cookie is not None and handshake.place is not None:
            self._send(handshake.place, self._init(handshake.cookie, handshake.place, now).pack())
            handshake.inits += 1
        handshake.wait(now, self._random(1)[0] / 127.5 - 1)

    def _hello(self, nonce: int) -> Hello:
        return self._tags.tagged(Hello(VERSION, nonce, release=OURS.release))

    def _init(self, cookie: Cookie, place: Place, now: float) -> Init:
        """Rule 2."""
        index, suite = self._new_index(), Suite(cookie.suite)
        payload = Request(self.instance, self.max_datagram_size, self.name).pack()
        noise = Initiator(self._key, suite, prologue(cookie), self._random(EPHEMERAL_SIZE))
        self._attempts[index] = Attempt(noise, suite, place, now)
        return self._tags.tagged(Init(cookie.version, cookie.suite, cookie.nonce, cookie.cookie, index,
                                      noise.write(payload)))

    def _on_packet(self, packet: Packet, source: Place, now: float) -> None:
        if isinstance(packet, Cookie):
            self._on_cookie(packet, source, now)
        elif isinstance(packet, Accept):
            self._on_accept(packet, now)
        elif isinstance(packet, Refuse):
            self._on_refuse(packet, source, now)
        elif isinstance(packet, Unknown):
            self._hinted |= self._entry is not None and packet.receiver == self._entry.session.their_index
        else:
            self.dropped['an operator\'s packet'] += 1

    def _on_cookie(self, cookie: Cookie, source: Place, now: float) -> None:
        """Rule 3."""
        handshake, place = self._handshake, self._place_of(source)
        if handshake is None or cookie.nonce != handshake.nonce:
            self.dropped['not asked for'] += 1
        elif cookie.version != VERSION or cookie.suite not in SUITES:
            self.dropped['another version or cipher'] += 1
        elif not self._tags.is_right(cookie):
            self.dropped['forged'] += 1
        elif place is None:
            self.dropped['another address'] += 1
            self._refusal = now, 'the robot answers from %s:%d: give this address instead' % address_of(source)
        elif cookie != handshake.cookie:
            if not handshake.asked:
                self.dropped['not asked for'] += 1
                return
            handshake.asked -= 1
            handshake.take(cookie, place, now)
            self._try(handshake, now)

    def _on_accept(self, accept: Accept, now: float) -> None:
        attempt = self._attempts.get(accept.receiver)
        if attempt is None:
            self.dropped['not asked for'] += 1
            return
        if (accept.version, accept.suite) != (VERSION, attempt.suite):
            self.dropped['another version or cipher'] += 1
            return
        try:
            payload = attempt.noise.read(accept.message)
        except Forged:
            self.dropped['forged'] += 1
            return
        del self._attempts[accept.receiver]
        reply = Reply.parse(payload)
        if reply.max_datagram_size < MIN_DATAGRAM_SIZE:
            raise Malformed('a robot that receives no handshake')
        keys = attempt.noise.keys()
        session = Session(accept.receiver, reply.sender, attempt.suite, keys.initiator, keys.responder)
        entry = Entry(session, reply.name, reply.instance, reply.max_datagram_size, attempt.place, now)
        self._join(entry, now - attempt.sent, now)

    def _join(self, entry: Entry, round_trip: float, now: float) -> None:
        """Rules 4 and 5."""
        self._handshake, self._refusal = None, (-math.inf, '')
        self._attempts.clear()
        robot = self.robot
        if robot is not None and robot.instance == entry.instance:
            self._change_keys(robot, entry, now)
            robot.place, robot.heard = entry.place, now
        else:
            if robot is not None:
                self._leave(robot, 'the robot was restarted')
            robot = self._add_peer(entry, now)
            self._events.append(Joined(robot))
        entry.peer, robot.round_trip = robot, round_trip
        self._entries[entry.session.index] = self._entry = entry
        self._find_paths(robot, now)
        self._hinted = self._confirmed = False
        self._ask_for_data(now)

    def _ask_for_data(self, now: float) -> None:
        """Let the robot know that its ACCEPT came: it uses the new keys then."""
        entry = self._entry
        if entry is None or entry.peer is None or now - entry.since >= CONFIRM_FOR:
            self._confirm_at = math.inf
            return
        self._send_control(entry.peer, Control.KEEP_ALIVE)
        self._confirm_at = now + CONFIRM

    def _on_refuse(self, refuse: Refuse, source: Place, now: float) -> None:
        """Rule 8."""
        if self._handshake is None or refuse.nonce != self._handshake.nonce or self._place_of(source) is None:
            self.dropped['not asked for'] += 1
            return
        try:
            reason = Reason(refuse.reason)
        except ValueError as error:
            raise Malformed('reason %d' % refuse.reason) from error
        if reason == Reason.VERSION:
            sentence = difference('the robot', Software(refuse.version, refuse.release), 'this machine', OURS)
        else:
            sentence = SENTENCES[reason]
        since, before = self._refusal
        if sentence != before or now - since >= REFUSAL_COUNTS:
            self._events.append(Refused(reason, sentence))
        self._refusal = now, sentence
        self._handshake.refused(now)

    def _confirm(self, entry: Entry, now: float) -> bool:
        """Rules 4 and 6."""
        if entry is self._entry:
            self._confirmed, self._hinted, self._confirm_at = True, False, math.inf
            if self._handshake is not None and self._handshake.silence:
                self._handshake = None
        return True

    def _update_problem(self, now: float) -> None:
        since, refusal = self._refusal
        robot = self.robot
        if not self._places:
            self.problem = 'the robot\'s address is not known'
        elif robot is not None and now - robot.heard < TELL_SILENCE:
            self.problem = None
        elif now - since < REFUSAL_COUNTS:
            self.problem = refusal
        else:
            self.problem = NO_ANSWER + ' or '.join(dict.fromkeys('%s:%d' % address_of(place) for place in self._places))

    def _leave(self, peer: Peer, reason: str) -> None:
        super()._leave(peer, reason)
        self._entry, self._paths, self._confirm_at = None, None, math.inf

    def _on_carried(self, peer: Peer, now: float) -> None:
        """Rule 10."""
        if self._paths is not None:
            self._paths.carried(now)

    def _on_shared(self, peer: Peer, source: Place, now: float) -> None:
        """Rule 10."""
        if self._paths is not None:
            self._paths.shared(source, now)

    def _on_place(self, peer: Peer, source: Place, size: int, now: float) -> None:
        """The robot has several addresses, or is behind a NAT: the one that was configured stays."""

    def _on_path(self, peer: Peer, kind: Control, body: bytes, source: Place, now: float) -> None:
        """Rule 10."""
        if kind == Control.PATH_CHALLENGE:
            self._send_control(peer, Control.PATH_RESPONSE, body, self._place_of(source) or peer.place)
        elif self._paths is None or not self._paths.take(body, now):
            self.dropped['not asked for'] += 1

    def _on_unknown(self, index: int, source: Place, now: float) -> None:
        """DATA of a session that has ended here: nothing to do."""
