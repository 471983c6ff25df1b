# SPDX-License-Identifier: BSD-3-Clause
"""What the two sides of a link tell each other of their topics, so that each sends what the other wants.

A topic's connection id follows from its name, type and md5 sum, so its data can be read without a negotiation, and
topics that differ cannot be confused. Three messages say the rest, on connection ids of their own (link/control.py):

* LISTS has the connection ids of its sender's topics: those that it wants to receive now, those that it receives but
  does not want now, and those that it sends. With the default streams and 40 relays it is one short datagram.
* NAMES has names, types and md5 sums of those topics that the receiver does not have, as its own LISTS says. It only
  serves to name differences; where both sides have the same topics there is none.
* SEEN acknowledges the parts of the latest LISTS and NAMES that were taken (parts.py), at once, and each HEARTBEAT. Who
  has forgotten a peer acknowledges nothing of them, and is told all anew.

All come from the network: they are checked, and bounded by MAX_TOPICS, MAX_TEXT and MAX_NAMES_SIZE.
"""
import enum
import hashlib
import itertools
import struct
import zlib
from typing import Dict, FrozenSet, List, NamedTuple, Optional, Sequence, Tuple

from ..budget import Budget
from ..packed import inflated
from .control import FIRST_TABLE_ID, FIRST_TOPIC_ID
from .packets import Malformed
from .parts import PART, Arriving, Repeated, capacity

MAX_TOPICS = 256
"""Maximum number of topics that one side sends, and of those that it receives."""

MAX_NAMES_SIZE = 1 << 16
"""Maximum size of NAMES, unpacked [byte]."""

MAX_TEXT = 200
"""Maximum length of a topic's name, type, md5 sum, or what it carries, in UTF-8 [byte]."""

HEARTBEAT = 1.0
"""Interval at which SEEN is repeated [s]."""

ANSWER_PERIOD = 0.02
"""Minimum interval between two SEEN: parts that arrive together are acknowledged together [s]."""

CHANGES, CHANGE_PERIOD = 16, 0.1
"""Number of changes that a peer may make at once, and interval of further ones: maps are repeated for each new
subscriber. A change beyond this limit is not acknowledged, so it comes again [1, s]."""

ID = struct.Struct('<I')
COUNTS = struct.Struct('<HH')
SEEN = struct.Struct('<IIII')
"""Number and parts taken, a bit for each, of LISTS and of NAMES."""


class Table(enum.IntEnum):
    """The connection ids of these messages."""
    LISTS = FIRST_TABLE_ID
    NAMES = FIRST_TABLE_ID + 1
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


class NameEntry(NamedTuple):
    """A line of NAMES."""
    role: Role
    topic: Topic


class Lists(NamedTuple):
    """The connection ids of a side's topics."""
    wants: FrozenSet[int] = frozenset()
    """It wants to receive them now."""
    declines: FrozenSet[int] = frozenset()
    """It receives them, but not now: the other side does not send them, or they cannot be decoded yet."""
    sends: FrozenSet[int] = frozenset()


def pack_lists(lists: Lists) -> bytes:
    """The message LISTS."""
    return COUNTS.pack(len(lists.wants), len(lists.declines)) + b''.join(
        ID.pack(number) for numbers in lists for number in sorted(numbers))


def parse_lists(data: bytes) -> Lists:
    """What a LISTS says.

    :raises Malformed: if it is none
    """
    body = len(data) - COUNTS.size
    if body < 0 or body % ID.size:
        raise Malformed('LISTS of %d bytes' % len(data))
    wants, declines = COUNTS.unpack_from(data)
    ids = [one for one, in ID.iter_unpack(data[COUNTS.size:])]
    received = wants + declines
    if received > min(len(ids), MAX_TOPICS) or len(ids) - received > MAX_TOPICS:
        raise Malformed('LISTS of %d topics' % len(ids))
    return Lists(frozenset(ids[:wants]), frozenset(ids[wants:received]), frozenset(ids[received:]))


def pack_names(entries: Sequence[NameEntry], longest: int) -> bytes:
    """The message NAMES, of the first entries if it would have more than `longest` bytes."""
    lines = [b''.join([bytes([role]), *(part for text in topic for part in _with_length(text))])
             for role, topic in entries]
    while True:
        data = b''.join(lines)
        names = zlib.compress(data, 9)
        if len(data) <= MAX_NAMES_SIZE and len(names) <= longest:
            return names
        lines = lines[:len(lines) // 2]


def _with_length(text: str) -> Tuple[bytes, bytes]:
    encoded = text.encode()
    return bytes([len(encoded)]), encoded


def parse_names(packed: bytes) -> List[NameEntry]:
    """The entries of a NAMES.

    :raises Malformed: if it is none
    """
    try:
        data, at, entries = inflated(packed, zlib.decompressobj(), MAX_NAMES_SIZE), 0, []
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
            entries.append(NameEntry(role, Topic(*texts)))
            if len(entries) > 2 * MAX_TOPICS:
                raise Malformed('too many topics')
        if len({(role, topic.name) for role, topic in entries}) < len(entries):
            raise Malformed('a topic stands twice')
    except (IndexError, ValueError) as error:
        raise Malformed('NAMES: %s' % error) from error
    return entries


class Local:
    """The topics of this side. One thread changes them at a time, others may read."""

    def __init__(self) -> None:
        self._topics: Dict[Role, Dict[str, Topic]] = {role: {} for role in Role}
        self._ids: Dict[Role, FrozenSet[int]] = {role: frozenset() for role in Role}
        self._numbers = itertools.count(1)
        self.number = next(self._numbers)
        """Number of the current state of the topics. It grows with each change."""

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
        if len(topics) >= MAX_TOPICS:
            raise ValueError('%s: there are too many topics' % topic.name)
        self._change(role, {**topics, topic.name: topic})

    def remove(self, role: Role, topic: Topic) -> None:
        """Remove a topic."""
        self._change(role, {name: other for name, other in self._topics[role].items() if name != topic.name})

    def _change(self, role: Role, topics: Dict[str, Topic]) -> None:
        self._topics = {**self._topics, role: topics}
        self._ids = {**self._ids, role: frozenset(topic.id for topic in topics.values())}
        self.number = self.next_number()

    def find(self, role: Role, name: str) -> Optional[Topic]:
        """A topic by its name."""
        return self._topics[role].get(name)

    def entries(self) -> List[NameEntry]:
        """All topics."""
        return [NameEntry(role, topic) for role, topics in self._topics.items() for topic in topics.values()]

    def ids(self, role: Role) -> FrozenSet[int]:
        """The connection ids of the topics with a role."""
        return self._ids[role]

    def next_number(self) -> int:
        """Higher than all before, for a message to any peer: one that was forgotten and came back goes on."""
        return next(self._numbers)


class Exchange:
    """What one peer and this side tell each other.

    :param local: this side's topics
    """

    def __init__(self, local: Local) -> None:
        self._local = local
        self.theirs: Optional[Lists] = None
        """The peer's topics; None: it has not said yet."""
        self._entries: List[NameEntry] = []
        self._differences: Dict[str, str] = {}
        self._compared = -1, -1     # numbers of the peer's NAMES and this side's topics, whose differences these are
        self._ours, self._names = Lists(), b''
        self._numbers = {Table.LISTS: 0, Table.NAMES: 0}    # of the present messages; 0: there is none
        self._made: Tuple[object, ...] = ()     # what they were made of
        self._out = {Table.LISTS: Repeated(), Table.NAMES: Repeated()}
        self._in = {Table.LISTS: Arriving(), Table.NAMES: Arriving()}
        self._changes = Budget(CHANGES, CHANGE_PERIOD)
        self._answer_due, self._answered = 0.0, -ANSWER_PERIOD

    @property
    def wants(self) -> FrozenSet[int]:
        """Connection ids that the peer wants."""
        return frozenset() if self.theirs is None else self.theirs.wants

    @property
    def offers(self) -> FrozenSet[int]:
        """Connection ids that the peer sends."""
        return frozenset() if self.theirs is None else self.theirs.sends

    def why_not(self, number: int) -> str:
        """Why the peer does not want a topic of this side, in words.

        :param number: its connection id
        """
        if self.theirs is None or not self._out[Table.LISTS].acknowledged:
            return 'does not know of it yet: the link loses too much'
        if number in self.theirs.declines:
            return 'cannot decode it yet: its log says why'
        name = next((topic.name for role, topic in self._local.entries()
                     if role == Role.SENDS and topic.id == number), None)
        if Role.RECEIVES in (role for role, theirs in self._entries if theirs.name == name):
            return 'does not receive it: its streams.yaml has another definition'
        return 'does not receive it: its log says why, or its streams.yaml lacks it'

    def renew(self) -> None:
        """The peer may have forgotten this side, but not the other way round: LISTS is sent at once.

        Its answer shows whether it has; then NAMES follows.
        """
        self._out[Table.LISTS].forgotten()

    def deadline(self) -> float:
        """When `messages` has something to send [s]."""
        return min(self._answer_due, *(out.due for out in self._out.values()))

    def messages(self, asked: FrozenSet[int], size: int, alive: bool, now: float) -> List[Tuple[Table, bytes]]:
        """What to send to the peer now: each one is a datagram.

        :param asked: connection ids that this side wants of it
        :param size: of the longest [byte]
        :param alive: whether the peer was heard lately
        """
        self._make(asked, size, now)
        messages: List[Tuple[Table, bytes]] = []
        if now >= self._answer_due:
            self._answered, self._answer_due = now, now + HEARTBEAT
            messages.append((Table.SEEN, SEEN.pack(*(value for one in self._in.values() for value in one.taken))))
        for kind, out in self._out.items():
            messages += [(kind, part) for part in out.take(alive, now)]
        return messages

    def _make(self, asked: FrozenSet[int], size: int, now: float) -> None:
        """Make LISTS and NAMES anew where they have changed."""
        made = asked, self._local.number, self._in[Table.LISTS].number
        if made == self._made:
            return
        self._made = made
        received = self._local.ids(Role.RECEIVES)
        lists = Lists(asked, received - asked, self._local.ids(Role.SENDS))
        if lists != self._ours or not self._numbers[Table.LISTS]:
            self._ours = lists
            self._put(Table.LISTS, pack_lists(lists), size, now)
        if self.theirs is not None:
            self._make_names(self.theirs, size, now)

    def _make_names(self, theirs: Lists, size: int, now: float) -> None:
        known = {Role.SENDS: theirs.wants | theirs.declines, Role.RECEIVES: theirs.sends}
        entries = [entry for entry in self._local.entries() if entry.topic.id not in known[entry.role]]
        if entries or self._numbers[Table.NAMES]:
            names = pack_names(entries, capacity(size))
            if names != self._names:
                self._names = names
                self._put(Table.NAMES, names, size, now)

    def _put(self, kind: Table, data: bytes, size: int, now: float) -> None:
        self._numbers[kind] = self._local.next_number()
        self._out[kind].put(self._numbers[kind], data, size, now)

    def take(self, kind: int, data: bytes, now: float) -> bool:
        """Take a datagram of the peer; returns whether it said something new.

        :raises Malformed: if it is none
        """
        if kind == Table.SEEN and len(data) == SEEN.size:
            values = SEEN.unpack(data)
            for out, number, taken in zip(self._out.values(), values[::2], values[1::2]):
                out.seen(number, taken, now)
            return False
        if kind not in self._in or len(data) < PART.size:
            raise Malformed('a message %d of %d bytes' % (kind, len(data)))
        self._answer_due = min(self._answer_due, self._answered + ANSWER_PERIOD)
        return self._take_part(Table(kind), data, now)

    def _take_part(self, kind: Table, data: bytes, now: float) -> bool:
        whole = self._in[kind].add(data, lambda: self._changes.take(now))
        if whole is None:
            return False
        if kind == Table.LISTS:
            self.theirs = parse_lists(whole)
        else:
            self._entries = parse_names(whole)
        return True

    def differences(self, peer: str) -> Dict[str, str]:
        """{topic: a sentence} of the topics that one side sends, and the other would receive, if they were the same.

        They are looked for where topics have changed only, whatever else the peer sends.

        :param peer: the other side, in words; always the same
        """
        numbers = self._in[Table.NAMES].number, self._local.number
        if numbers != self._compared:
            self._compared, self._differences = numbers, self._compare(peer)
        return self._differences

    def _compare(self, peer: str) -> Dict[str, str]:
        found = {}
        for role, theirs in self._entries:
            ours = self._local.find(Role(1 - role), theirs.name)
            if ours is not None and ours != theirs:
                verbs = ('sends', 'receives') if role == Role.SENDS else ('receives', 'sends')
                found[theirs.name] = '%s: %s %s %s, this machine %s %s' % (
                    theirs.name, peer, verbs[0], theirs.content, verbs[1], ours.content)
        return found
