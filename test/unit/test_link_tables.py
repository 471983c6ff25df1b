# SPDX-License-Identifier: BSD-3-Clause
"""What the sides of a link tell each other of their topics: bytes, lossy exchanges, and hostile messages."""
import random
import zlib
from typing import Any, FrozenSet, List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.link.control import FIRST_TOPIC_ID
from smokebot_udp.link.parts import PART
from smokebot_udp.link.tables import (
    CHANGE_PERIOD,
    CHANGES,
    HEARTBEAT,
    MAX_NAMES_SIZE,
    MAX_TEXT,
    MAX_TOPICS,
    SEEN,
    Exchange,
    Lists,
    Local,
    Malformed,
    NameEntry,
    Role,
    Table,
    Topic,
    pack_lists,
    pack_names,
    parse_lists,
    parse_names,
)

SIZE = 1400
"""Size of a datagram's content [byte]."""

IMAGE = Topic('/image', 'sensor_msgs/Image', '060021388200f6f0f447d0fcd9c64743')
RELAY = Topic('/odom', 'smokebot_udp/RelaySegment', 'aa', 'nav_msgs/Odometry bb')

texts = st.text(st.characters(min_codepoint=33, max_codepoint=0x24f).filter(str.isprintable), min_size=1, max_size=60)
topics = st.builds(Topic, texts, texts, texts, st.one_of(st.just(''), texts))
entries = st.lists(st.builds(NameEntry, st.sampled_from(list(Role)), topics), max_size=20,
                   unique_by=lambda entry: (entry.role, entry.topic.name))


def test_a_connection_id_follows_from_name_type_and_md5() -> None:
    # b2sum's relative: hashlib.blake2s(b'/image sensor_msgs/Image 06...43', digest_size=4) is 3a9c5fa6
    assert IMAGE.id == 0xa65f9c3a
    assert len({IMAGE.id, IMAGE._replace(name='/other').id, IMAGE._replace(type='x/Image').id,
                IMAGE._replace(md5='0').id, IMAGE._replace(carries='x/Y 0').id}) == 5


@given(topics)
def test_a_connection_id_is_none_of_the_links_own(topic: Topic) -> None:
    assert FIRST_TOPIC_ID <= topic.id < 1 << 32


def part(number: int, data: bytes) -> bytes:
    """A message in one datagram."""
    return PART.pack(number, 0, 1) + data


def lists(number: int, wants: Any = (), declines: Any = (), sends: Any = ()) -> bytes:
    return part(number, pack_lists(Lists(frozenset(wants), frozenset(declines), frozenset(sends))))


def names(number: int, *rows: NameEntry) -> bytes:
    return part(number, pack_names(rows, MAX_NAMES_SIZE))


def test_the_bytes_of_the_messages() -> None:
    assert pack_lists(Lists(frozenset([0x01020304, 16]), frozenset([17]), frozenset([18, 19]))) == bytes.fromhex(
        '0200 0100 10000000 04030201 11000000 12000000 13000000')
    assert zlib.decompress(pack_names([NameEntry(Role.RECEIVES, Topic('/a', 'b/C', 'd'))], 1000)) == \
        b'\1' + b'\2/a' + b'\3b/C' + b'\1d' + b'\0'


@given(entries)
def test_names_are_read_as_they_were_written(rows: List[NameEntry]) -> None:
    assert parse_names(pack_names(rows, MAX_NAMES_SIZE)) == rows


def test_names_that_are_too_many_are_cut() -> None:
    rows = [NameEntry(Role.SENDS, Topic('/%032x' % random.getrandbits(128), 'x/Y', '0')) for _ in range(MAX_TOPICS)]
    packed = pack_names(rows, 2000)
    read = parse_names(packed)
    assert len(packed) <= 2000 and read == rows[:len(read)] and len(read) >= 32
    long = [NameEntry(Role.SENDS, Topic('/%d' % number, 'x' * MAX_TEXT, 'y' * MAX_TEXT, 'z' * MAX_TEXT))
            for number in range(2 * MAX_TOPICS)]
    assert len(parse_names(pack_names(long, MAX_NAMES_SIZE))) >= 64


ids = st.sets(st.integers(0, 2 ** 32 - 1), max_size=MAX_TOPICS // 2).map(frozenset)


@given(st.builds(Lists, ids, ids, ids))
def test_lists_are_read_as_they_were_written(one: Lists) -> None:
    assert parse_lists(pack_lists(one)) == one


@given(entries, st.data())
def test_mutated_names_are_read_or_refused(rows: List[NameEntry], data: Any) -> None:
    packed = bytearray(pack_names(rows, MAX_NAMES_SIZE))
    plain = data.draw(st.booleans())
    table = bytearray(zlib.decompress(packed)) if plain else packed
    for _ in range(data.draw(st.integers(1, 4)) if table else 0):
        table[data.draw(st.integers(0, len(table) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(table[:data.draw(st.integers(0, len(table)))])
    try:
        read = parse_names(zlib.compress(cut) if plain else cut)
    except Malformed:
        return
    assert all(text.isprintable() and len(text.encode()) <= MAX_TEXT for _, topic in read for text in topic)


@pytest.mark.parametrize('data', [
    b'', b'\0' * 3, b'\0' * 5, b'\1\0\0\0', b'\0\0\1\0', b'\xff' * 8,
    b'\0\0\0\0' + b'\0' * 4 * (MAX_TOPICS + 1), b'\1\1\0\0' + b'\0' * 4 * (MAX_TOPICS + 1)])
def test_lists_that_contradict_themselves_are_malformed(data: bytes) -> None:
    with pytest.raises(Malformed):
        parse_lists(data)


@pytest.mark.parametrize('data', [b'', b'x', zlib.compress(b'\0'), zlib.compress(b'')[:-1], zlib.compress(b'') + b'x',
                                  zlib.compress(bytes(50_000_000))], ids=lambda data: '%d bytes' % len(data))
def test_names_that_are_none_are_malformed(data: bytes) -> None:
    """One of them would be 50 MB."""
    with pytest.raises(Malformed):
        parse_names(data)


def test_names_without_end_are_malformed() -> None:
    with pytest.raises(Malformed, match='too many'):
        parse_names(pack_names([NameEntry(Role.SENDS, Topic('/a', 'b', 'c'))] * (2 * MAX_TOPICS + 1), MAX_NAMES_SIZE))


def test_a_topic_that_stands_twice_is_malformed() -> None:
    """Each would be a sentence of its own."""
    with pytest.raises(Malformed, match='twice'):
        parse_names(pack_names([NameEntry(Role.SENDS, IMAGE), NameEntry(Role.SENDS, IMAGE._replace(md5='0'))], 1000))
    parse_names(pack_names([NameEntry(Role.SENDS, IMAGE), NameEntry(Role.RECEIVES, IMAGE._replace(md5='0'))], 1000))


def test_a_topic_is_there_once() -> None:
    local = Local()
    local.add(Role.SENDS, IMAGE)
    local.add(Role.RECEIVES, IMAGE)
    with pytest.raises(ValueError, match='/image is published already'):
        local.add(Role.SENDS, IMAGE._replace(type='x/Y'))
    local.remove(Role.SENDS, IMAGE)
    local.add(Role.SENDS, IMAGE._replace(type='x/Y'))
    with pytest.raises(ValueError, match='longer than 200 bytes'):
        local.add(Role.SENDS, IMAGE._replace(name='/' + 'x' * MAX_TEXT))
    with pytest.raises(ValueError, match='too many'):
        for number in range(MAX_TOPICS):
            local.add(Role.RECEIVES, Topic('/%d' % number, 'x/Y', '0'))


def test_two_names_with_one_connection_id_are_an_error() -> None:
    """Found by trying: 4 bytes of a hash."""
    local, one, other = Local(), Topic('/collision/18059', 'x/Y', '0'), Topic('/collision/44186', 'x/Y', '0')
    assert one.id == other.id
    local.add(Role.SENDS, one)
    with pytest.raises(ValueError, match='/collision/44186 has the connection id of /collision/18059'):
        local.add(Role.SENDS, other)


class Side:
    """An exchange with a peer, and the topics of its side."""

    def __init__(self, *roles: Tuple[Role, Topic]) -> None:
        self.local = Local()
        for role, topic in roles:
            self.local.add(role, topic)
        self.asked: FrozenSet[int] = frozenset()
        self.exchange = Exchange(self.local)


def run(one: Side, other: Side, start: float, stop: float, loss: float = 0.0, seed: int = 0) -> int:
    """Let two sides exchange messages, with a delay of 50 ms each way; returns how many were sent."""
    chance, now, count = random.Random(seed), start, 0
    on_the_way: List[Tuple[float, Side, int, bytes]] = []
    while now < stop:
        for side, peer in ((one, other), (other, one)):
            for kind, data in side.exchange.messages(side.asked, SIZE, True, now):
                count += 1
                if chance.random() >= loss:
                    on_the_way.append((now + 0.05 + 0.02 * chance.random(), peer, kind, data))
        for message in [message for message in on_the_way if message[0] <= now]:
            on_the_way.remove(message)
            message[1].exchange.take(message[2], message[3], now)
        now += 0.01
    return count


@pytest.mark.parametrize('loss', [0.0, 0.2, 0.5, 0.8])
@pytest.mark.parametrize('seed', range(5))
def test_each_side_learns_what_the_other_wants(loss: float, seed: int) -> None:
    robot, operator = Side((Role.SENDS, IMAGE)), Side((Role.RECEIVES, IMAGE))
    operator.asked = frozenset([IMAGE.id])
    run(operator, robot, 0.0, 6.0, loss, seed)
    assert robot.exchange.wants == {IMAGE.id} and not operator.exchange.wants
    assert operator.exchange.offers == {IMAGE.id} and not robot.exchange.offers
    operator.asked = frozenset()
    robot.local.add(Role.SENDS, RELAY)
    run(operator, robot, 6.0, 12.0, loss, seed)
    assert not robot.exchange.wants and operator.exchange.offers == {IMAGE.id, RELAY.id}


def test_a_side_that_forgot_the_other_learns_all_again() -> None:
    robot, operator = Side((Role.SENDS, IMAGE)), Side((Role.RECEIVES, IMAGE._replace(type='x/Y')))
    operator.asked, robot.asked = frozenset([IMAGE.id]), frozenset([5])
    for asked in (frozenset([6]), frozenset([7])):
        run(operator, robot, 0.0, 2.0)
        robot.asked = asked
    run(operator, robot, 2.0, 4.0)
    robot.exchange = Exchange(robot.local)
    now = 4.0 + HEARTBEAT + 1.0
    run(operator, robot, 4.0, now)
    assert robot.exchange.wants == {IMAGE.id} and operator.exchange.wants == {7}
    robot.asked = frozenset()
    run(operator, robot, now, now + 2.0)
    assert not operator.exchange.wants
    assert len(robot.exchange.differences('desk')) == 1


def test_an_idle_exchange_is_cheap() -> None:
    robot, operator = Side((Role.SENDS, IMAGE)), Side((Role.RECEIVES, IMAGE))
    operator.asked = frozenset([IMAGE.id])
    run(operator, robot, 0.0, 2.0)
    assert run(operator, robot, 2.0, 12.0) <= 2 * 11      # SEEN each second, each way


def test_sides_with_the_same_topics_send_no_names() -> None:
    robot = Side((Role.SENDS, IMAGE), (Role.RECEIVES, RELAY))
    operator = Side((Role.RECEIVES, IMAGE), (Role.SENDS, RELAY))
    kinds = []
    for step in range(20):
        for one, other in ((robot, operator), (operator, robot)):
            for kind, data in one.exchange.messages(frozenset(), SIZE, True, step / 10):
                kinds.append(kind)
                other.exchange.take(kind, data, step / 10)
    assert set(kinds) == {Table.LISTS, Table.SEEN}
    robot.local.add(Role.SENDS, RELAY._replace(name='/only_here'))
    assert Table.NAMES in [kind for kind, _ in robot.exchange.messages(frozenset(), SIZE, True, 2.0)]


def test_names_that_no_longer_differ_are_taken_back() -> None:
    theirs = IMAGE._replace(md5='0')
    robot, operator = Side((Role.SENDS, theirs)), Side((Role.RECEIVES, IMAGE))
    run(robot, operator, 0.0, 1.0)
    assert robot.exchange.differences('desk') and operator.exchange.differences('ugv1')
    robot.local.remove(Role.SENDS, theirs)
    run(robot, operator, 1.0, 2.0)
    assert not robot.exchange.differences('desk') and not operator.exchange.differences('ugv1')


def test_why_a_topic_is_not_wanted() -> None:
    robot, operator = Side((Role.SENDS, IMAGE), (Role.SENDS, RELAY)), Side((Role.RECEIVES, IMAGE))
    assert 'does not know of it yet' in robot.exchange.why_not(IMAGE.id)
    robot.exchange.take(Table.LISTS, lists(1, declines=[IMAGE.id]), 0.0)
    assert 'does not know of it yet' in robot.exchange.why_not(IMAGE.id)    # it has not acknowledged
    run(robot, operator, 0.0, 1.0)
    assert 'cannot decode it' in robot.exchange.why_not(IMAGE.id)
    assert 'does not receive it: its log says why' in robot.exchange.why_not(RELAY.id)
    operator.local.add(Role.RECEIVES, RELAY._replace(md5='0'))
    run(robot, operator, 1.0, 2.0)
    assert 'does not receive it: its streams.yaml has another definition' in robot.exchange.why_not(RELAY.id)
    operator.local.remove(Role.RECEIVES, IMAGE)     # as where PyAV cannot be loaded
    run(robot, operator, 2.0, 3.0)
    assert 'does not receive it: its log says why' in robot.exchange.why_not(IMAGE.id)


def test_an_older_message_changes_nothing() -> None:
    side = Side((Role.RECEIVES, IMAGE))
    theirs = NameEntry(Role.SENDS, IMAGE._replace(md5='0'))
    side.exchange.take(Table.LISTS, lists(5, [IMAGE.id], sends=[7]), 0.0)
    side.exchange.take(Table.LISTS, lists(4, []), 0.0)
    side.exchange.take(Table.NAMES, names(6, theirs), 0.0)
    side.exchange.take(Table.NAMES, names(5), 0.0)
    assert side.exchange.wants == {IMAGE.id} and side.exchange.offers == {7} and side.exchange.differences('ugv1')
    assert side.exchange.messages(frozenset(), SIZE, True, 0.0)[0] == (Table.SEEN, SEEN.pack(5, 1, 6, 1))


def test_a_peer_changes_its_mind_so_often_only() -> None:
    side, taken = Side((Role.SENDS, IMAGE)), []
    for number in range(1, 1000):
        side.exchange.take(Table.LISTS, lists(number, [number % 2]), 0.001 * number)
        taken.append(side.exchange.wants)
    changes = sum(before != after for before, after in zip(taken, taken[1:]))
    assert CHANGES - 1 <= changes <= CHANGES + 1.0 / CHANGE_PERIOD
    assert side.exchange.messages(frozenset(), SIZE, True, 1.0)[0] == (Table.SEEN, SEEN.pack(999, 0, 0, 0))
    side.exchange.take(Table.LISTS, lists(1000, [5]), 2.0)
    assert side.exchange.wants == {5}


def test_a_flood_of_tables_is_answered_rarely() -> None:
    side, answers = Side((Role.SENDS, IMAGE)), 0
    for number in range(1, 10001):
        side.exchange.take(Table.LISTS, lists(number), 1e-4 * number)
        answers += sum(kind == Table.SEEN for kind, _ in side.exchange.messages(frozenset(), SIZE, True, 1e-4 * number))
    assert answers <= 51


@pytest.mark.parametrize('kind, data', [(Table.SEEN, b'\0' * 7), (Table.LISTS, b'\0'), (Table.NAMES, b'\0'),
                                        (Table.LISTS, part(1, b'\0')), (Table.NAMES, PART.pack(1, 1, 1)),
                                        (Table.NAMES, PART.pack(1, 0, 33)), (7, b''), (15, b'\0' * 8)])
def test_a_message_of_no_correct_peer_is_refused(kind: int, data: bytes) -> None:
    with pytest.raises(Malformed):
        Side().exchange.take(kind, data, 0.0)


@pytest.mark.parametrize('theirs, sentence', [
    (IMAGE, None), (IMAGE._replace(name='/other', type='x/Y'), None),
    (IMAGE._replace(type='x/Y', md5='0'),
     '/image: ugv1 sends x/Y 0, this machine receives sensor_msgs/Image 060021388200f6f0f447d0fcd9c64743')])
def test_differences_are_named(theirs: Topic, sentence: Any) -> None:
    side = Side((Role.RECEIVES, IMAGE))
    side.exchange.take(Table.NAMES, names(1, NameEntry(Role.SENDS, theirs), NameEntry(Role.RECEIVES, IMAGE)), 0.0)
    assert side.exchange.differences('ugv1') == ({'/image': sentence} if sentence else {})


def test_other_carried_messages_are_a_difference() -> None:
    side = Side((Role.SENDS, RELAY))
    theirs = RELAY._replace(carries='nav_msgs/Odometry c')
    side.exchange.take(Table.NAMES, names(1, NameEntry(Role.RECEIVES, theirs)), 0.0)
    assert list(side.exchange.differences('desk').values()) == [
        '/odom: desk receives smokebot_udp/RelaySegment aa that carries nav_msgs/Odometry c, '
        'this machine sends smokebot_udp/RelaySegment aa that carries nav_msgs/Odometry bb']


def test_differences_are_looked_for_where_topics_have_changed_only(monkeypatch: Any) -> None:
    """A peer can send thousands of messages a second that change nothing."""
    side, compared = Side((Role.RECEIVES, IMAGE)), []
    find = side.local.find

    def count(role: Role, name: str) -> Optional[Topic]:
        compared.append(name)
        return find(role, name)

    monkeypatch.setattr(side.local, 'find', count)
    theirs = IMAGE._replace(md5='0')
    side.exchange.take(Table.NAMES, names(1, NameEntry(Role.SENDS, theirs)), 0.0)
    for number in range(100):
        side.exchange.take(Table.LISTS, lists(number), 0.0)
        assert len(side.exchange.differences('ugv1')) == 1
    assert compared == ['/image']
    side.local.remove(Role.RECEIVES, IMAGE)
    assert not side.exchange.differences('ugv1')
    side.local.add(Role.RECEIVES, theirs)
    assert not side.exchange.differences('ugv1')
