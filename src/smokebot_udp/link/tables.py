# SPDX-License-Identifier: BSD-3-Clause
"""What the two sides of a link tell each other of their topics, so that each sends what the other wants.

A topic's connection id follows from its name, type and md5 sum, so its data can be read without a negotiation, and
topics that differ cannot be confused. Two messages say the rest, on connection ids of their own (link/control.py):

* WANTS lists the ids that its sender wants to receive now. It is sent at once, repeated until it is acknowledged, at
  each change, under new keys, and each WANTS_PERIOD.
* TABLE lists its sender's topics with names, types and md5 sums. It only serves to name differences, and to ask for a
  topic no sooner than the other side offers it. It is repeated until it is acknowledged.
* SEEN acknowledges: the number of the latest WANTS and the latest TABLE that were taken. Who has forgotten a peer says
  0, and is sent the TABLE anew.

All come from the network: they are checked, and bounded by MAX_TOPICS and MAX_TEXT.
"""
import enum
import hashlib
import itertools
import math
import struct
from typing import Dict, FrozenSet, Iterable, List, NamedTuple, Optional, Tuple

from ..budget import Budget
from .control import FIRST_TABLE_ID, FIRST_TOPIC_ID
from .packets import Malformed

MAX_TOPICS = 256
"""Of one side."""

MAX_TABLE_SIZE = 1 << 16
"""[byte]"""

MAX_TEXT = 200
"""Of a topic's name, type, md5 sum, or what it carries, in UTF-8 [byte]."""

FIRST_RETRY, LAST_RETRY, RETRY_GROWTH = 0.05, 0.5, 1.5
"""Time to the first repetition of what was not acknowledged, to the later ones at most, and the factor from one to the
next [s, s, 1]."""

WANTS_PERIOD = 5.0
"""[s]"""

CHANGES, CHANGE_PERIOD = 16, 0.1
"""Changes that a peer may make at once, and the time for each further one: maps are repeated for who begins to want
them. What is not taken is not acknowledged, and comes again [1, s]."""

ID = struct.Struct('<I')
NUMBERS = struct.Struct('<II')
COUNT = struct.Struct('<H')


class Table(enum.IntEnum):
    """The connection ids of these messages."""
    WANTS = FIRST_TABLE_ID
    TABLE = FIRST_TABLE_ID + 1
    SEEN = FIRST_TABLE_ID + 2


class Role(enum.IntEnum):
    """What a side does with a topic."""
    SENDS = 0
    RECEIVES = 1


class Topic(NamedTuple):
    """A topic as one side has it."""
    name: str
    type: str
    md5: str
    carries: str = ''
    """Type and md5 sum of the messages within its messages; empty: there are none."""

    @property
    def id(self) -> int:
        """Its connection id, FIRST_TOPIC_ID and above."""
        text = ' '.join(filter(None, self))
        number = ID.unpack(hashlib.blake2s(text.encode(), digest_size=ID.size).digest())[0]
        return int(number if number >= FIRST_TOPIC_ID else number + FIRST_TOPIC_ID)

    @property
    def content(self) -> str:
        """What its messages are, in words."""
        carried = ' that carries %s' % self.carries if self.carries else ''
        return '%s %s%s' % (self.type, self.md5, carried)


class Entry(NamedTuple):
    """A line of a TABLE."""
    role: Role
    topic: Topic


def pack_wants(number: int, ids: Iterable[int]) -> bytes:
    """The message WANTS.

    :param number: higher for a later one
    """
    return ID.pack(number) + b''.join(map(ID.pack, sorted(ids)))


def parse_wants(data: bytes) -> Tuple[int, FrozenSet[int]]:
    """(number, ids) of a WANTS.

    :raises Malformed: if it is none
    """
    if not data or len(data) % ID.size or len(data) > ID.size * (1 + MAX_TOPICS):
        raise Malformed('WANTS of %d bytes' % len(data))
    number, *ids = (one for one, in ID.iter_unpack(data))
    return number, frozenset(ids)


def pack_table(number: int, entries: Iterable[Entry]) -> bytes:
    """The message TABLE."""
    out = [ID.pack(number)]
    for role, topic in entries:
        out.append(bytes([role]))
        for text in topic:
            encoded = text.encode()
            out += [bytes([len(encoded)]), encoded]
    return b''.join(out)


def parse_table(data: bytes) -> Tuple[int, List[Entry]]:
    """(number, entries) of a TABLE.

    :raises Malformed: if it is none
    """
    try:
        number, at, entries = ID.unpack_from(data)[0], ID.size, []
        while at < len(data):
            role, at = Role(data[at]), at + 1
            texts = []
            for _ in Topic._fields:
                text = data[at + 1:at + 1 + data[at]]
                if len(text) != data[at] or len(text) > MAX_TEXT:
                    raise Malformed('a text of %d bytes' % data[at])
                texts.append(text.decode())
                at += 1 + len(text)
            if not all(text.isprintable() for text in texts) or not all(texts[:3]):
                raise Malformed('a topic without a name')
            entries.append(Entry(role, Topic(*texts)))
            if len(entries) > 2 * MAX_TOPICS:
                raise Malformed('too many topics')
        if len({(role, topic.name) for role, topic in entries}) < len(entries):
            raise Malformed('a topic stands twice')
    except (struct.error, IndexError, ValueError) as error:
        raise Malformed('a TABLE: %s' % error) from error
    return number, entries


class Local:
    """The topics of this side. One thread changes them at a time, others may read."""

    def __init__(self) -> None:
        self._topics: Dict[Role, Dict[str, Topic]] = {role: {} for role in Role}
        self._numbers = itertools.count(1)
        self.number = next(self._numbers)
        """Of this state, higher for a later one."""

    def add(self, role: Role, topic: Topic) -> None:
        """Add a topic.

        :raises ValueError: if there is one of its name, or of its connection id, or there are too many
        """
        topics = self._topics[role]
        if topic.name in topics:
            raise ValueError('%s is %s already' % (topic.name, ('published', 'subscribed')[role]))
        same = [other.name for other in topics.values() if other.id == topic.id]
        if same:
            raise ValueError('%s has the connection id of %s: rename one of them' % (topic.name, same[0]))
        if any(len(text.encode()) > MAX_TEXT for text in topic):
            raise ValueError('%s: its name or type is longer than %d bytes' % (topic.name, MAX_TEXT))
        if len(topics) >= MAX_TOPICS or len(pack_table(0, [*self.entries(), Entry(role, topic)])) > MAX_TABLE_SIZE:
            raise ValueError('%s: there are too many topics' % topic.name)
        self._topics = {**self._topics, role: {**topics, topic.name: topic}}
        self.number = self.next_number()

    def remove(self, role: Role, topic: Topic) -> None:
        """Remove a topic."""
        left = {name: other for name, other in self._topics[role].items() if name != topic.name}
        self._topics = {**self._topics, role: left}
        self.number = self.next_number()

    def find(self, role: Role, name: str) -> Optional[Topic]:
        """A topic by its name."""
        return self._topics[role].get(name)

    def entries(self) -> List[Entry]:
        """All topics, as for the TABLE."""
        return [Entry(role, topic) for role, topics in self._topics.items() for topic in topics.values()]

    def next_number(self) -> int:
        """Higher than all before, for a message to any peer: one that was forgotten and came back goes on."""
        return next(self._numbers)


class Repeated:
    """When a message is due, that is repeated until it is acknowledged.

    :param period: after this time an acknowledged one is repeated, too [s]
    """

    def __init__(self, period: float = math.inf) -> None:
        self._period = period
        self._number, self._acknowledged = 0, False     # of the message sent last
        self._due, self._interval = -math.inf, FIRST_RETRY

    def deadline(self, number: int) -> float:
        """When message `number` is due [s]."""
        return self._due if number == self._number else -math.inf

    def take(self, number: int, now: float) -> bool:
        """Whether message `number` is due; then it is sent."""
        if now < self.deadline(number):
            return False
        if number != self._number:
            self._number, self._acknowledged, self._interval = number, False, FIRST_RETRY
        self._due = now + (self._period if self._acknowledged else self._interval)
        self._interval = min(LAST_RETRY, self._interval * RETRY_GROWTH)
        return True

    def seen(self, number: int, now: float) -> None:
        """The other side has taken message `number` last."""
        if number == self._number:
            self._acknowledged, self._due = True, now + self._period
        elif self._acknowledged:
            self.forgotten()

    def forgotten(self) -> None:
        """The other side may have forgotten it: it is due at once."""
        self._acknowledged, self._due, self._interval = False, -math.inf, FIRST_RETRY


class Exchange:
    """What one peer and this side tell each other.

    :param local: this side's topics
    """

    def __init__(self, local: Local) -> None:
        self._local = local
        self.wants: FrozenSet[int] = frozenset()
        """Connection ids that the peer wants."""
        self.offers: Dict[int, Topic] = {}
        """{connection id: topic} that the peer sends."""
        self._entries: List[Entry] = []
        self._differences: List[str] = []
        self._compared = -1, -1     # numbers of the peer's and this side's topics, whose differences these are
        self._asked: FrozenSet[int] = frozenset()
        self._asked_number = 0
        self._wants_seen = self._table_seen = 0     # numbers of the peer's
        self._changes = Budget(CHANGES, CHANGE_PERIOD)
        self._wants_out, self._table_out, self._answer = Repeated(WANTS_PERIOD), Repeated(), False

    def renew(self) -> None:
        """The peer may have forgotten this side, but not the other way round: WANTS is sent at once.

        Its answer shows whether it has; then the TABLE follows.
        """
        self._wants_out.forgotten()

    def deadline(self) -> float:
        """When `messages` has something to send [s]."""
        if self._answer:
            return -math.inf
        return min(self._wants_out.deadline(self._asked_number), self._table_out.deadline(self._local.number))

    def messages(self, asked: FrozenSet[int], now: float) -> List[Tuple[Table, bytes]]:
        """What to send to the peer now.

        :param asked: connection ids that this side wants of it
        """
        if asked != self._asked or not self._asked_number:
            self._asked, self._asked_number = asked, self._local.next_number()
        number, out = self._local.number, []
        if self._answer:
            out.append((Table.SEEN, NUMBERS.pack(self._wants_seen, self._table_seen)))
            self._answer = False
        if self._wants_out.take(self._asked_number, now):
            out.append((Table.WANTS, pack_wants(self._asked_number, asked)))
        if self._table_out.take(number, now):
            out.append((Table.TABLE, pack_table(number, self._local.entries())))
        return out

    def take(self, kind: int, data: bytes, now: float) -> None:
        """Take a message of the peer.

        :raises Malformed: if it is none
        """
        if kind == Table.WANTS:
            number, ids = parse_wants(data)
            if number > self._wants_seen and self._changes.take(now):
                self._wants_seen, self.wants = number, ids
            self._answer = True
        elif kind == Table.TABLE and len(data) >= ID.size:
            if ID.unpack_from(data)[0] > self._table_seen and self._changes.take(now):
                self._table_seen, self._entries = parse_table(data)
                self.offers = {topic.id: topic for role, topic in self._entries if role == Role.SENDS}
            self._answer = True
        elif kind == Table.SEEN and len(data) == NUMBERS.size:
            wants, table = NUMBERS.unpack(data)
            self._wants_out.seen(wants, now)
            self._table_out.seen(table, now)
        else:
            raise Malformed('a message %d of %d bytes' % (kind, len(data)))

    def differences(self, peer: str) -> List[str]:
        """The topics that one side sends, and the other would receive, if they were the same: a sentence for each.

        They are looked for where topics have changed only, whatever else the peer sends.

        :param peer: the other side, in words; always the same
        """
        numbers = self._table_seen, self._local.number
        if numbers != self._compared:
            self._compared, self._differences = numbers, self._compare(peer)
        return self._differences

    def _compare(self, peer: str) -> List[str]:
        found = []
        for role, theirs in self._entries:
            ours = self._local.find(Role(1 - role), theirs.name)
            if ours is not None and ours != theirs:
                verbs = ('sends', 'receives') if role == Role.SENDS else ('receives', 'sends')
                found.append('%s: %s %s %s, this machine %s %s' % (
                    theirs.name, peer, verbs[0], theirs.content, verbs[1], ours.content))
        return found
