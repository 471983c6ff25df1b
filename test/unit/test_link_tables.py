# SPDX-License-Identifier: BSD-3-Clause
"""What the sides of a link tell each other of their topics: bytes, lossy exchanges, and hostile messages."""
import random
from typing import Any, FrozenSet, List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.link.control import FIRST_TOPIC_ID
from smokebot_udp.link.tables import (
    CHANGE_PERIOD,
    CHANGES,
    FIRST_RETRY,
    LAST_RETRY,
    MAX_TEXT,
    MAX_TOPICS,
    NUMBERS,
    WANTS_PERIOD,
    Entry,
    Exchange,
    Local,
    Malformed,
    Repeated,
    Role,
    Table,
    Topic,
    pack_table,
    pack_wants,
    parse_table,
    parse_wants,
)

IMAGE = Topic('/image', 'sensor_msgs/Image', '060021388200f6f0f447d0fcd9c64743')
RELAY = Topic('/odom', 'smokebot_udp/RelaySegment', 'aa', 'nav_msgs/Odometry bb')

texts = st.text(st.characters(min_codepoint=33, max_codepoint=0x24f).filter(str.isprintable), min_size=1, max_size=60)
topics = st.builds(Topic, texts, texts, texts, st.one_of(st.just(''), texts))
entries = st.lists(st.builds(Entry, st.sampled_from(list(Role)), topics), max_size=20,
                   unique_by=lambda entry: (entry.role, entry.topic.name))


def test_a_connection_id_follows_from_name_type_and_md5() -> None:
    # b2sum's relative: hashlib.blake2s(b'/image sensor_msgs/Image 06...43', digest_size=4) is 3a9c5fa6
    assert IMAGE.id == 0xa65f9c3a
    assert len({IMAGE.id, IMAGE._replace(name='/other').id, IMAGE._replace(type='x/Image').id,
                IMAGE._replace(md5='0').id, IMAGE._replace(carries='x/Y 0').id}) == 5


@given(topics)
def test_a_connection_id_is_none_of_the_links_own(topic: Topic) -> None:
    assert FIRST_TOPIC_ID <= topic.id < 1 << 32


def test_the_bytes_of_the_messages() -> None:
    assert pack_wants(3, {0x01020304, 16}) == bytes.fromhex('03000000 10000000 04030201')
    assert pack_table(7, [Entry(Role.RECEIVES, Topic('/a', 'b/C', 'd'))]) == \
        b'\7\0\0\0' + b'\1' + b'\2/a' + b'\3b/C' + b'\1d' + b'\0'


@given(st.integers(0, 2 ** 32 - 1), entries)
def test_a_table_is_read_as_it_was_written(number: int, rows: List[Entry]) -> None:
    assert parse_table(pack_table(number, rows)) == (number, rows)


@given(st.sets(st.integers(0, 2 ** 32 - 1), max_size=MAX_TOPICS))
def test_wants_are_read_as_they_were_written(ids: Any) -> None:
    assert parse_wants(pack_wants(1, ids)) == (1, ids)


@given(entries, st.data())
def test_a_mutated_table_is_read_or_refused(rows: List[Entry], data: Any) -> None:
    table = bytearray(pack_table(1, rows))
    for _ in range(data.draw(st.integers(1, 4))):
        table[data.draw(st.integers(0, len(table) - 1))] = data.draw(st.integers(0, 255))
    try:
        _, read = parse_table(bytes(table[:data.draw(st.integers(0, len(table)))]))
    except Malformed:
        return
    assert all(text.isprintable() and len(text.encode()) <= MAX_TEXT for _, topic in read for text in topic)


@pytest.mark.parametrize('data', [
    b'', b'\0' * 3, b'\0' * 5, b'\0' * (4 + 4 * MAX_TOPICS + 4)])
def test_wants_of_another_length_are_malformed(data: bytes) -> None:
    with pytest.raises(Malformed):
        parse_wants(data)


def test_a_table_without_end_is_malformed() -> None:
    with pytest.raises(Malformed):
        parse_table(pack_table(1, [Entry(Role.SENDS, RELAY)] * (2 * MAX_TOPICS + 1)))


def test_a_topic_that_stands_twice_is_malformed() -> None:
    """Each would be a sentence of its own."""
    with pytest.raises(Malformed, match='twice'):
        parse_table(pack_table(1, [Entry(Role.SENDS, IMAGE), Entry(Role.SENDS, IMAGE._replace(md5='0'))]))
    parse_table(pack_table(1, [Entry(Role.SENDS, IMAGE), Entry(Role.RECEIVES, IMAGE._replace(md5='0'))]))


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


def test_a_message_is_repeated_until_it_is_acknowledged() -> None:
    repeated, sent = Repeated(), []
    for step in range(200):
        if repeated.take(1, 0.01 * step):
            sent.append(step)
    gaps = [later - earlier for earlier, later in zip(sent, sent[1:])]
    assert sent[0] == 0 and gaps == sorted(gaps)
    assert gaps[0] == round(100 * FIRST_RETRY) and gaps[-1] == round(100 * LAST_RETRY)
    repeated.seen(1, 2.0)
    assert not repeated.take(1, 1e9)
    repeated.seen(0, 1e9)       # forgotten
    assert repeated.take(1, 1e9) and repeated.take(2, 1e9)


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
            for kind, data in side.exchange.messages(side.asked, now):
                count += 1
                if chance.random() >= loss:
                    on_the_way.append((now + 0.05 + 0.02 * chance.random(), peer, kind, data))
        for message in [message for message in on_the_way if message[0] <= now]:
            on_the_way.remove(message)
            message[1].exchange.take(message[2], message[3], now)
        now += 0.01
    return count


@pytest.mark.parametrize('loss', [0.0, 0.2, 0.5])
@pytest.mark.parametrize('seed', range(5))
def test_each_side_learns_what_the_other_wants(loss: float, seed: int) -> None:
    robot, operator = Side((Role.SENDS, IMAGE)), Side((Role.RECEIVES, IMAGE))
    operator.asked = frozenset([IMAGE.id])
    run(operator, robot, 0.0, 6.0, loss, seed)
    assert robot.exchange.wants == {IMAGE.id} and not operator.exchange.wants
    assert operator.exchange.offers == {IMAGE.id: IMAGE} and not robot.exchange.offers
    operator.asked = frozenset()
    robot.local.add(Role.SENDS, RELAY)
    run(operator, robot, 6.0, 12.0, loss, seed)
    assert not robot.exchange.wants and operator.exchange.offers.keys() == {IMAGE.id, RELAY.id}


def test_a_side_that_forgot_the_other_learns_all_again() -> None:
    robot, operator = Side((Role.SENDS, IMAGE)), Side((Role.RECEIVES, IMAGE._replace(type='x/Y')))
    operator.asked, robot.asked = frozenset([IMAGE.id]), frozenset([5])
    for asked in (frozenset([6]), frozenset([7])):
        run(operator, robot, 0.0, 2.0)
        robot.asked = asked
    run(operator, robot, 2.0, 4.0)
    robot.exchange = Exchange(robot.local)
    now = 4.0 + WANTS_PERIOD + 1.0
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
    assert run(operator, robot, 2.0, 12.0) <= 4 * 11      # WANTS and SEEN each second, each way


def test_an_older_message_changes_nothing() -> None:
    side = Side((Role.SENDS, IMAGE))
    side.exchange.take(Table.WANTS, pack_wants(5, [IMAGE.id]), 0.0)
    side.exchange.take(Table.WANTS, pack_wants(4, []), 0.0)
    side.exchange.take(Table.TABLE, pack_table(5, [Entry(Role.SENDS, RELAY)]), 0.0)
    side.exchange.take(Table.TABLE, pack_table(4, []), 0.0)
    assert side.exchange.wants == {IMAGE.id} and side.exchange.offers == {RELAY.id: RELAY}
    assert side.exchange.messages(frozenset(), 0.0)[0] == (Table.SEEN, NUMBERS.pack(5, 5))


def test_a_peer_changes_its_mind_so_often_only() -> None:
    side, taken = Side((Role.SENDS, IMAGE)), []
    for number in range(1, 1000):
        side.exchange.take(Table.WANTS, pack_wants(number, [number % 2]), 0.001 * number)
        taken.append(side.exchange.wants)
    changes = sum(before != after for before, after in zip(taken, taken[1:]))
    assert CHANGES - 1 <= changes <= CHANGES + 1.0 / CHANGE_PERIOD
    side.exchange.take(Table.WANTS, pack_wants(1000, [5]), 2.0)
    assert side.exchange.wants == {5}


@pytest.mark.parametrize('kind, data', [(Table.SEEN, b'\0' * 7), (Table.WANTS, b'\0'), (Table.TABLE, b'\0'),
                                        (7, b''), (15, b'\0' * 8)])
def test_a_message_of_no_correct_peer_is_refused(kind: int, data: bytes) -> None:
    with pytest.raises(Malformed):
        Side().exchange.take(kind, data, 0.0)


@pytest.mark.parametrize('theirs, sentence', [
    (IMAGE, None), (IMAGE._replace(name='/other', type='x/Y'), None),
    (IMAGE._replace(type='x/Y', md5='0'),
     '/image: ugv1 sends x/Y 0, this machine receives sensor_msgs/Image 060021388200f6f0f447d0fcd9c64743')])
def test_differences_are_named(theirs: Topic, sentence: Any) -> None:
    side = Side((Role.RECEIVES, IMAGE))
    side.exchange.take(Table.TABLE, pack_table(1, [Entry(Role.SENDS, theirs), Entry(Role.RECEIVES, IMAGE)]), 0.0)
    assert side.exchange.differences('ugv1') == ([sentence] if sentence else [])


def test_other_carried_messages_are_a_difference() -> None:
    side = Side((Role.SENDS, RELAY))
    theirs = RELAY._replace(carries='nav_msgs/Odometry c')
    side.exchange.take(Table.TABLE, pack_table(1, [Entry(Role.RECEIVES, theirs)]), 0.0)
    assert side.exchange.differences('desk') == [
        '/odom: desk receives smokebot_udp/RelaySegment aa that carries nav_msgs/Odometry c, '
        'this machine sends smokebot_udp/RelaySegment aa that carries nav_msgs/Odometry bb']


def test_differences_are_looked_for_where_topics_have_changed_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """A peer can send thousands of messages a second that change nothing."""
    side, compared = Side((Role.RECEIVES, IMAGE)), []
    find = side.local.find

    def count(role: Role, name: str) -> Optional[Topic]:
        compared.append(name)
        return find(role, name)

    monkeypatch.setattr(side.local, 'find', count)
    theirs = IMAGE._replace(md5='0')
    side.exchange.take(Table.TABLE, pack_table(1, [Entry(Role.SENDS, theirs)]), 0.0)
    for number in range(100):
        side.exchange.take(Table.WANTS, pack_wants(number, []), 0.0)
        assert len(side.exchange.differences('ugv1')) == 1
    assert compared == ['/image']
    side.local.remove(Role.RECEIVES, IMAGE)
    assert not side.exchange.differences('ugv1')
    side.local.add(Role.RECEIVES, theirs)
    assert not side.exchange.differences('ugv1')
