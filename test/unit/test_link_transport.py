# SPDX-License-Identifier: BSD-3-Clause
"""Robot and operators on real sockets, in one process."""
import collections
import os
import select
import socket
import threading
import time
from typing import Any, Dict, Iterator, List

import numpy as np
import pytest
from link_channel import data
from link_pair import KEY, Inbox, Links, Told, frame, links
from polling import WAIT, wait_for
from sensor_msgs.msg import CompressedImage, Image, LaserScan
from std_msgs.msg import Header, String

from smokebot_udp.link.packets import OVERHEAD, Suite
from smokebot_udp.link.parts import PART
from smokebot_udp.link.peer import Carried, Delivery, Joined, Left, Peer, Quiet
from smokebot_udp.link.peer_topics import PeerTopics
from smokebot_udp.link.place import Place
from smokebot_udp.link.session import Session
from smokebot_udp.link.tables import SEEN, Lists, Local, NameEntry, Role, Table, Topic, pack_lists, pack_names
from smokebot_udp.link.topics import Outgoing, headed
from smokebot_udp.link.transport import Datagrams, shares
from smokebot_udp.udpros.datagram import HEADER, IP_UDP_HEADERS
from smokebot_udp.udpros.endpoints import BatchSender
from smokebot_udp.udpros.packetizer import no_limit

THERMAL = '/smokebot_udp/thermal/segments'
CHAT = '/smokebot_udp/chat'


@pytest.fixture
def made() -> Iterator[Links]:
    with links() as one:
        yield one


def session(index: int) -> Session:
    return Session(index, index + 1, Suite.AESGCM, KEY, KEY)


def settle(*publishers: Any, count: int = 1) -> None:
    """Wait until each publisher has that many peers."""
    wait_for(lambda: all(publisher.get_num_connections() == count for publisher in publishers))


def test_a_short_receive_buffer_is_a_remark(made: Links, monkeypatch: Any) -> None:
    assert not made.robot()[0].stats(0.0).remarks      # type: ignore[union-attr]
    monkeypatch.setattr('smokebot_udp.udpros.endpoints._grow_receive_buffer', lambda sock, size: 425984)
    robot, _ = made.robot()
    operator, _ = made.operator(robot.port, remarks=['this is a test'])
    text = ('the kernel grants a receive buffer that is too short for bursts: 212992 bytes only, '
            'sudo sysctl -w net.core.rmem_max=4194304')
    assert operator.stats(0.0).remarks == ['this is a test', text]      # type: ignore[union-attr]
    assert robot.stats(0.0).remarks == [text]                           # type: ignore[union-attr]


def test_shares_add_up_to_the_whole() -> None:
    assert shares(10, [1, 0, 1]) == [5, 0, 5] and shares(1, [3, 0, 0]) == [1, 0, 0]
    for total in range(20):
        found = shares(total, [5, 1, 0, 7])
        assert sum(found) == total and all(abs(share - total * weight / 13) < 1 for share, weight in zip(
            found, [5, 1, 0, 7]))


def test_connections_have_their_shares_of_what_the_kernel_drops(made: Links) -> None:
    robot, _ = made.robot()
    publishers = [robot.publisher(topic, CompressedImage) for topic in (THERMAL, CHAT)]
    operator, _ = made.operator(robot.port, datagrams=Datagrams(receive_buffer=4096))
    slow = threading.Event()

    def hang(records: Any, mask: Any) -> None:
        """The link's thread does not receive meanwhile."""
        slow.wait(WAIT)
    subscribers = [operator.subscriber(topic, CompressedImage, batch_callback=hang) for topic in (THERMAL, CHAT)]
    settle(*publishers)

    def drops() -> List[int]:
        return [sum(one['kernel_drops'] for one in subscriber.connections()) for subscriber in subscribers]
    assert drops() == [0, 0]
    image = frame(CompressedImage, 300, 1300)
    publishers[0].publish_frames(image)
    slow.set()

    def all_told() -> bool:
        publishers[0].publish_frames(image.part(0, 1))      # drops show with what comes after
        lost = operator.dropped()['receive buffer full']
        return lost > 100 and sum(drops()) == lost
    wait_for(all_told)
    assert drops()[0] > 100 and drops()[1] == 0


def test_frames_arrive_as_records(made: Links) -> None:
    robot, _ = made.robot()
    publisher = robot.publisher(THERMAL, CompressedImage)
    operator, _ = made.operator(robot.port)
    inbox = Inbox()
    subscriber = operator.subscriber(THERMAL, CompressedImage, batch_callback=inbox.batch, arrived=inbox.arrived)
    settle(publisher)
    image = frame(CompressedImage, 300, 1300)
    assert publisher.publish_frames(image.part(0, 100), image.part(100, 300)) == 1
    inbox.wait(lambda: len(inbox.records) == 300)
    assert inbox.records == [record.tobytes() for record in image.records]
    assert image.records['header']['seq'].tolist() == list(range(1, 301))
    assert publisher.publish_frames(image.part(0, 1)) == 301

    size = image.datagram_size + robot.overhead + 28
    wait_for(lambda: sum(what[3] for what in inbox.arrivals) == 301)
    assert sum(what[2] for what in inbox.arrivals) == 301 * size
    stats, = subscriber.connections()
    assert stats['peer'] == '/robot_sender@ugv1' and stats['address'] == ('127.0.0.1', robot.port)
    assert (stats['datagrams'], stats['received'], stats['lost'], stats['dropped']) == (301, 301, 0, {})
    assert stats['bytes'] == 301 * image.datagram_size and 0 <= stats['idle'] < 10
    sent, = publisher.connections()
    assert (sent['peer'], sent['datagrams'], sent['failures']) == ('/operator_receiver@desk1', 301, {})
    assert sent['max_datagram_size'] == robot.max_datagram_size == 1472 - robot.overhead


def test_each_topic_has_its_ip_headers_and_marks_are_counted(made: Links) -> None:
    """What a congested queue would mark is sent as marked here."""
    robot, _ = made.robot(datagrams=Datagrams(tos_mask=0xff))
    images, chat = robot.publisher(THERMAL, CompressedImage, tos=0x8b), robot.publisher(CHAT, String, tos=0xb8)
    operator, _ = made.operator(robot.port)
    inbox = Inbox()
    operator.subscriber(THERMAL, CompressedImage, batch_callback=inbox.batch, arrived=inbox.arrived)
    operator.subscriber(CHAT, String, inbox.message)
    settle(images, chat)
    images.publish_frames(frame(CompressedImage, 40, 1300))
    chat.publish(String('between'))
    images.publish_frames(frame(CompressedImage, 2, 100))
    inbox.wait(lambda: len(inbox.records) == 42 and inbox.messages)
    assert sum(what[-2] for what in inbox.arrivals) == 42
    images.tos = 0x8a

    def is_unmarked() -> bool:
        """Whether one more datagram arrives unmarked."""
        number = len(inbox.records)
        images.publish_frames(frame(CompressedImage, 1, 100))
        inbox.wait(lambda: len(inbox.records) > number)
        return not inbox.arrivals[-1][-2]
    wait_for(is_unmarked)


def test_ip_headers_are_left_alone_where_that_is_wanted(made: Links) -> None:
    robot, _ = made.robot(datagrams=Datagrams(tos_mask=0xfc))
    publisher = robot.publisher(THERMAL, CompressedImage, tos=0x8b)
    operator, _ = made.operator(robot.port)
    inbox = Inbox()
    operator.subscriber(THERMAL, CompressedImage, batch_callback=inbox.batch, arrived=inbox.arrived)
    settle(publisher)
    publisher.publish_frames(frame(CompressedImage, 2, 1300))
    inbox.wait(lambda: len(inbox.records) == 2)
    assert sum(what[-2] for what in inbox.arrivals) == 0 and publisher.tos == 0x88


@pytest.mark.parametrize('size', [1, 1400, 1500, 200_000])
def test_messages_of_any_length_arrive_in_both_directions(made: Links, size: int) -> None:
    robot, _ = made.robot()
    operator, _ = made.operator(robot.port)
    for one, other in ((robot, operator), (operator, robot)):
        inbox = Inbox()
        other.subscriber(CHAT, String, inbox.message)
        publisher = one.publisher(CHAT, String)
        settle(publisher)
        for text in ('a' * size, 'b' * size):
            publisher.publish(String(text))
        inbox.wait(lambda inbox=inbox: len(inbox.messages) == 2)
        assert [message.data[0] for message in inbox.messages] == ['a', 'b']
        assert {len(message.data) for message in inbox.messages} == {size}
        header = inbox.messages[0]._connection_header
        assert header is inbox.messages[1]._connection_header and header['callerid'] == one.name


def test_each_message_is_numbered_in_its_header(made: Links) -> None:
    robot, _ = made.robot()
    operator, _ = made.operator(robot.port)
    inbox = Inbox()
    operator.subscriber('/scan', LaserScan, inbox.message, queue_size=100, arrived=inbox.arrived)
    publisher = robot.publisher('/scan', LaserScan)
    settle(publisher)
    for number in range(20):
        publisher.publish(LaserScan(header=Header(seq=99, frame_id='laser'), ranges=[float(number)]))
    inbox.wait(lambda: len(inbox.messages) == 20)
    assert [message.header.seq for message in inbox.messages] == list(range(1, 21))
    assert {message.header.frame_id for message in inbox.messages} == {'laser'}
    assert [seq for _, seq, *_ in inbox.arrivals][-1] == 20


def test_frames_longer_than_a_datagram_are_cut(made: Links) -> None:
    """The operator receives less than the robot would send."""
    robot, _ = made.robot()
    publisher = robot.publisher(THERMAL, CompressedImage)
    operator, _ = made.operator(robot.port, datagrams=Datagrams(700))
    inbox = Inbox()
    operator.subscriber(THERMAL, CompressedImage, batch_callback=inbox.batch)
    settle(publisher)
    image = frame(CompressedImage, 3, 1200)
    publisher.publish_frames(image)
    inbox.wait(lambda: len(inbox.records) == 3)
    assert inbox.records == [record.tobytes() for record in image.records]
    sent, = publisher.connections()
    assert sent['max_datagram_size'] == 700 - robot.overhead and sent['datagrams'] == 6


def test_two_operators_get_what_each_wants(made: Links) -> None:
    robot, _ = made.robot()
    image, chat = robot.publisher(THERMAL, CompressedImage), robot.publisher(CHAT, String)
    inboxes = [Inbox(), Inbox()]
    names = ['/operator_receiver@desk1', '/operator_receiver@desk2']
    for name, inbox in zip(names, inboxes):
        operator, _ = made.operator(robot.port, name)
        operator.subscriber(THERMAL, CompressedImage, batch_callback=inbox.batch)
        if name == names[1]:
            operator.subscriber(CHAT, String, inbox.message)
    settle(image, count=2)
    settle(chat)
    assert {connection['peer'] for connection in image.connections()} == set(names)
    assert [connection['peer'] for connection in chat.connections()] == names[1:]
    whole = frame(CompressedImage, 5, 100)
    image.publish_frames(whole, limits={names[0]: 2, '/nobody': 0})
    chat.publish(String('hello'))
    inboxes[1].wait(lambda: len(inboxes[1].records) == 5 and inboxes[1].messages)
    inboxes[0].wait(lambda: len(inboxes[0].records) == 2)
    assert inboxes[0].records == inboxes[1].records[:2] and not inboxes[0].messages

    one = frame(CompressedImage, 1, 100)
    one.records['header']['seq'] = 77
    image.publish_to('/nobody', one)
    image.publish_to(names[0], one)
    inboxes[0].wait(lambda: len(inboxes[0].records) == 3)
    assert inboxes[0].records[2] == one.records.tobytes() and one.records['header']['seq'] == 77
    assert len(inboxes[1].records) == 5
    with pytest.raises(ValueError):
        image.publish_to(names[0], frame(Image, 1, 100))


def test_operators_of_one_name_are_told_apart(made: Links) -> None:
    robot, _ = made.robot()
    publisher, heard = robot.publisher(THERMAL, CompressedImage), Inbox()
    robot.subscriber(CHAT, String, heard.message)
    inboxes = [Inbox(), Inbox()]
    for number, inbox in enumerate(inboxes):
        operator, _ = made.operator(robot.port)
        operator.subscriber(THERMAL, CompressedImage, batch_callback=inbox.batch)
        chat = operator.publisher(CHAT, String)
        settle(publisher, count=number + 1)
        settle(chat)
        chat.publish(String(str(number)))
    names = ['/operator_receiver@desk1', '/operator_receiver@desk1 #2']
    assert [connection['peer'] for connection in publisher.connections()] == names
    heard.wait(lambda: len(heard.messages) == 2)
    assert [message._connection_header['callerid'] for message in heard.messages] == names
    publisher.publish_frames(frame(CompressedImage, 3, 100), limits={names[1]: 1})
    inboxes[0].wait(lambda: len(inboxes[0].records) == 3)
    inboxes[1].wait(lambda: len(inboxes[1].records) == 1)


class Listener:
    def __init__(self) -> None:
        self.calls: List[Any] = []

    def peer_subscribe(self, topic: str, publish: Any, peer_publish: Any) -> None:
        self.calls.append(topic)
        peer_publish(String('for you'))


def test_a_peer_begins_and_ends_to_want_a_topic(made: Links) -> None:
    robot, _ = made.robot()
    operator, _ = made.operator(robot.port)
    listener, inbox, willing = Listener(), Inbox(), threading.Event()
    asked: List[bool] = []

    def wanted() -> bool:
        asked.append(willing.is_set())
        return willing.is_set()
    other = robot.publisher('/other', String)
    operator.subscriber('/other', String, lambda _: None)
    subscriber = operator.subscriber(CHAT, String, inbox.message, wanted=wanted)
    settle(other)
    assert not asked        # the robot does not offer it
    publisher = robot.publisher(CHAT, String, subscriber_listener=listener)
    wait_for(lambda: asked)
    assert not publisher.get_num_connections()
    willing.set()
    inbox.wait(lambda: inbox.messages)
    assert listener.calls == [CHAT] and inbox.messages[0].data == 'for you'
    subscriber.unregister()
    settle(publisher, count=0)
    operator.subscriber(CHAT, String, inbox.message)        # and again
    settle(publisher)
    assert listener.calls == [CHAT, CHAT]
    publisher.unregister()
    robot.publisher(CHAT, String, subscriber_listener=listener)
    wait_for(lambda: len(listener.calls) == 3)


@pytest.mark.parametrize('ours, theirs, words', [
    ({'message_class': CompressedImage}, {'message_class': Image},
     (CompressedImage._type, Image._type, CompressedImage._md5sum, Image._md5sum)),
    ({'carries': 'nav_msgs/Odometry aaaa'}, {'carries': 'nav_msgs/Odometry bbbb'}, ('carries', 'aaaa', 'bbbb'))])
def test_a_difference_is_told_once_on_both_sides(made: Links, ours: Dict[str, Any], theirs: Dict[str, Any],
                                                 words: Any) -> None:
    robot, robot_told = made.robot()
    operator, operator_told = made.operator(robot.port)
    options = {'topic': THERMAL, 'message_class': CompressedImage}
    different, same = robot.publisher(**{**options, **ours}), robot.publisher(CHAT, String)
    operator.subscriber(**{**options, **theirs}, callback=lambda _: None)
    operator.subscriber(CHAT, String, lambda _: None)
    settle(same)
    wait_for(lambda: robot_told and operator_told)
    robot.publisher('/one/more', String)        # the tables are exchanged anew
    operator.subscriber('/last', String, lambda _: None)
    settle(robot.publisher('/last', String))
    assert len(robot_told) == len(operator_told) == 1 and not different.get_num_connections()
    for told in robot_told + operator_told:
        assert THERMAL in told and all(word in told for word in words)
    assert 'sends' in robot_told[0].split('this machine')[1] and operator.problem() == operator_told[0]


def test_the_robot_is_restarted(made: Links) -> None:
    robot, _ = made.robot()
    publisher = robot.publisher(CHAT, String)
    operator, _ = made.operator(robot.port)
    inbox = Inbox()
    subscriber = operator.subscriber(CHAT, String, inbox.message)
    settle(publisher)
    publisher.publish(String('before'))
    inbox.wait(lambda: len(inbox.messages) == 1)
    port = robot.port
    robot.close()
    robot, _ = made.robot(port)
    publisher = robot.publisher(CHAT, String)
    settle(publisher)
    publisher.publish(String('after'))
    inbox.wait(lambda: len(inbox.messages) == 2)
    first, second = (message._connection_header for message in inbox.messages)
    assert first is not second and first['callerid'] == second['callerid']
    assert len(subscriber.connections()) == len(operator.stats(0.0).peers) == 1


def test_new_keys_let_a_side_say_at_once_what_it_wants() -> None:
    """The robot may have forgotten an operator that slept for a minute; LISTS was acknowledged long ago."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot, \
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as operator:
        robot.bind(('127.0.0.1', 0))
        robot.settimeout(WAIT)
        operator.setblocking(False)
        peer = Peer(1, 'ugv1', 'ugv1', bytes(16), 1472, Place(0x7f000001, robot.getsockname()[1]), session(1), 0.0)
        topics, wanted = PeerTopics(peer, Local(), BatchSender(operator)), frozenset([77])
        topics.asked = wanted
        topics.send(0.0)
        assert len(robot.recv(2000)) > 0 and len(robot.recv(2000)) > 0
        topics.exchange.take(Table.SEEN, SEEN.pack(2, 1, 0, 0), 0.1)
        topics.send(0.2)
        assert not select.select([robot], [], [], 0)[0]
        peer.use(session(4))
        topics.send(0.2)
        packet = np.frombuffer(robot.recv(2000), np.uint8)[np.newaxis]
        opened = session(4).open(packet, np.array([packet.size]), np.arange(1), collections.Counter())
        assert opened.datagrams.tobytes()[HEADER.size + PART.size:] == pack_lists(Lists(wanted))


def test_a_wrong_key_is_a_problem_in_one_sentence(made: Links) -> None:
    robot, told = made.robot()
    operator, _ = made.operator(robot.port, key=bytes(32))
    wait_for(lambda: 'key' in (operator.problem() or ''))
    wait_for(lambda: told)
    assert 'key' in told[0] and len(told) == 1 and robot.problem() is None
    stats = robot.stats(0.0)
    assert stats is not None and not stats.peers
    assert stats.dropped['refused: wrong key'] > 0


def test_the_key_is_replaced_while_both_run(made: Links) -> None:
    """An operator with the former key is refused; one that has the new one joins by itself."""
    new, renewed = bytes(reversed(KEY)), {'robot': False, 'desk': False}

    def renew(side: str) -> Any:
        def key(now: float) -> Any:
            due, renewed[side] = renewed[side], False
            return new if due else None
        return key
    robot, _ = made.robot(renewed=renew('robot'))
    publisher, inbox = robot.publisher(CHAT, String), Inbox()
    operator, _ = made.operator(robot.port, renewed=renew('desk'))
    operator.subscriber(CHAT, String, inbox.message)
    settle(publisher)
    renewed['robot'] = True
    wait_for(lambda: 'another key' in (operator.problem() or ''))
    assert not robot.stats(0.0).peers
    renewed['desk'] = True
    settle(publisher)
    publisher.publish(String('sealed anew'))
    inbox.wait(lambda: inbox.messages)
    late, _ = made.operator(robot.port, '/lost_desk')
    wait_for(lambda: 'another key' in (late.problem() or ''))


def test_nine_operators_of_one_robot(made: Links) -> None:
    """The ninth is told why it has to wait, and has the place of the first one that leaves."""
    robot, told = made.robot()
    publisher, inboxes, operators = robot.publisher(CHAT, String), [], []
    for number in range(8):
        operator, _ = made.operator(robot.port, '/desk%d' % number)
        inboxes.append(Inbox())
        operator.subscriber(CHAT, String, inboxes[-1].message)
        operators.append(operator)
    settle(publisher, count=8)
    ninth, _ = made.operator(robot.port, '/desk9')
    inbox = Inbox()
    ninth.subscriber(CHAT, String, inbox.message)
    wait_for(lambda: 'as many operators as it takes' in (ninth.problem() or ''))
    wait_for(lambda: told)
    assert 'there are 8 operators already' in told[0]
    publisher.publish(String('to all'))
    for one in inboxes:
        one.wait(lambda one=one: one.messages)
    operators[3].close()
    wait_for(lambda: '/desk9' in [connection['peer'] for connection in publisher.connections()])
    publisher.publish(String('again'))
    inbox.wait(lambda: inbox.messages)


def test_a_port_in_use_is_an_error(made: Links) -> None:
    robot, _ = made.robot()
    with pytest.raises(OSError, match='in use'):
        made.robot(robot.port)


def test_forged_datagrams_change_nothing(made: Links) -> None:
    robot, _ = made.robot()
    publisher = robot.publisher(CHAT, String)
    operator, _ = made.operator(robot.port)
    inbox = Inbox()
    operator.subscriber(CHAT, String, inbox.message)
    settle(publisher)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as visitor:
        for kind in range(10):
            for size in (1, 15, 32, 500, 1472, 3000):
                visitor.sendto(bytes([kind, 1, 0, 0]) + os.urandom(size), ('127.0.0.1', robot.port))
    publisher.publish(String('hello'))
    inbox.wait(lambda: inbox.messages)
    wait_for(lambda: sum(robot.dropped().values()) >= 50
             and {'too long', 'malformed', 'unknown session'} <= set(robot.dropped()))
    assert [peer.name for peer in robot.stats(0.0).peers] == ['/operator_receiver@desk1']


def test_who_plans_is_told_at_once_that_an_operators_first_path_is_quiet(made: Links) -> None:
    robot, told = made.robot()[0], []
    peer = Peer(99, 'anybody', 'anybody', bytes(16), 1472, Place(0x7f000001, 9), session(1), 0.0)
    robot.on_event(Joined(peer))
    robot.on_moved = lambda: told.append(robot.paths(0.0)['anybody'][0].is_quiet)
    peer.is_quiet = True
    robot.on_event(Quiet(peer))
    assert told == [True]


def test_who_joins_and_leaves_again_and_again_does_not_fill_the_log() -> None:
    with links() as made:
        told = Told()
        robot, _ = made.robot(log=told)
        peer = Peer(99, 'anybody', 'anybody', bytes(16), 1472, Place(0x7f000001, 9), session(1), 0.0)
        for _ in range(1000):
            robot.on_event(Joined(peer))
            robot.on_event(Left(peer, 'closed'))
        assert told[:2] == ['anybody has joined from 127.0.0.1:9', 'anybody has left: closed']
        assert len(told) < 100


def test_what_was_not_asked_for_is_not_delivered(made: Links) -> None:
    """A peer sends it all the same."""
    robot, _ = made.robot()
    events: List[Any] = []
    on_event = robot.on_event
    robot.on_event = lambda event: (events.append(event), on_event(event))     # type: ignore[method-assign]
    operator, _ = made.operator(robot.port)
    inbox, willing = Inbox(), threading.Event()
    operator.subscriber('/other', String, lambda _: None)
    operator.subscriber(CHAT, String, inbox.message, wanted=willing.is_set)
    publisher = robot.publisher(CHAT, String)
    settle(robot.publisher('/other', String))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as another:
        outgoing = Outgoing(events[0].peer, BatchSender(another), publisher.topic.id, 1400, no_limit)
        outgoing.packetizer.send_message(headed(String('unasked'), 1))
    wait_for(lambda: operator.dropped()['not asked for'] == 1)
    willing.set()
    settle(publisher)
    publisher.publish(String('asked'))
    inbox.wait(lambda: inbox.messages)
    assert [message.data for message in inbox.messages] == ['asked']


def test_bytes_are_counted_by_address(made: Links) -> None:
    """Also what went to former peers of the name, and with all headers."""
    robot, _ = made.robot()
    operator, _ = made.operator(robot.port, hosts=['127.0.0.2', '127.0.0.1'])

    def carried() -> Carried:
        stats = operator.stats(time.monotonic())
        assert stats is not None
        return dict(stats.peers[0].carried) if stats.peers else {}
    wait_for(lambda: set(carried()) == {('127.0.0.1', ''), ('127.0.0.2', '')})      # it is asked at both
    publisher, inbox = operator.publisher(CHAT, String), Inbox()
    robot.subscriber(CHAT, String, inbox.message)
    settle(publisher)
    before = sum(carried().values())
    for _ in range(100):
        publisher.publish(String('x' * 1000))
    inbox.wait(lambda: len(inbox.messages) == 100)
    sent = sum(carried().values()) - before
    assert 100 * (1000 + HEADER.size + OVERHEAD + IP_UDP_HEADERS) < sent < 150000
    robot.close()
    again, _ = made.robot(robot.port)
    wait_for(lambda: operator.stats(0.0).handshakes == 2)       # type: ignore[union-attr]
    assert sum(carried().values()) > before + sent


def test_why_a_peer_gets_no_topic(made: Links) -> None:
    robot, _ = made.robot()
    operator, _ = made.operator(robot.port)
    operator.subscriber(THERMAL, CompressedImage, lambda _: None, wanted=lambda: False)
    thermal, chat, other = (robot.publisher(*one) for one in (
        (THERMAL, CompressedImage), (CHAT, String), ('/other', String)))
    operator.subscriber('/other', String, lambda _: None)
    settle(other)
    wait_for(lambda: 'cannot decode' in thermal.why_not(operator.name))
    assert 'does not receive it' in chat.why_not(operator.name)
    assert chat.why_not('/nobody') == 'is not connected'


def test_a_peers_tables_do_not_silence_the_differences_to_others() -> None:
    """Thirty tables of topics that all differ, joined and left again and again."""
    with links() as made:
        robot, told = made.robot()
        for number in range(100):
            robot.publisher('/topic%d' % number, String)
        names = [NameEntry(Role.RECEIVES, Topic('/topic%d' % number, 'x/Y', '0')) for number in range(100)]
        table = np.frombuffer(data(Table.NAMES, PART.pack(1, 0, 1) + pack_names(names, 10 ** 6)), np.uint8)[np.newaxis]
        now = time.monotonic()
        for visit in range(30):
            visitor = Peer(1000 + visit, 'visitor', 'visitor', bytes(16), 1472, Place(0x7f000001, 9),
                            session(1), now)
            robot.on_event(Joined(visitor))
            robot.on_delivery(Delivery(visitor, table, np.array([table.shape[1]]), np.zeros(1, np.int64)),
                              lambda row: now, now)
            for step in range(100):
                robot.poll(now + step)
            robot.on_event(Left(visitor, 'closed'))
        assert 30 <= len(told) <= 50 + 30 * 101
        operator, operator_told = made.operator(robot.port)
        operator.subscriber('/topic7', CompressedImage, lambda _: None)
        wait_for(lambda: any(operator.name in text for text in told))


def test_a_topic_has_one_publisher(made: Links) -> None:
    robot, _ = made.robot()
    publisher = robot.publisher(CHAT, String)
    with pytest.raises(ValueError, match='published already'):
        robot.publisher(CHAT, String)
    with pytest.raises(ValueError, match='publishes std_msgs/String'):
        publisher.publish(Header())
    publisher.unregister()
    robot.publisher(CHAT, Header)


def test_a_callback_that_fails_is_reported(made: Links) -> None:
    robot, _ = made.robot()
    operator, told = made.operator(robot.port)
    inbox = Inbox()

    def callback(message: Any) -> None:
        inbox.message(message)
        raise KeyError(message.data)
    operator.subscriber(CHAT, String, callback)
    publisher = robot.publisher(CHAT, String)
    settle(publisher)
    for text in 'ab':
        publisher.publish(String(text))
    inbox.wait(lambda: len(inbox.messages) == 2)
    wait_for(lambda: len(told) == 2)
    assert CHAT in told[0] and 'KeyError' in told[0]


def test_closing_leaves_nothing_behind() -> None:
    def open_files() -> int:
        return len(os.listdir('/proc/self/fd'))
    before, threads = open_files(), set(threading.enumerate())
    with links() as made:
        robot, _ = made.robot()
        operator, _ = made.operator(robot.port)
        publisher = robot.publisher(CHAT, String)
        operator.subscriber(CHAT, String, lambda _: None)
        settle(publisher)
        operator.close()
        settle(publisher, count=0)      # the robot was told
    publisher.publish(String('too late'))
    assert set(threading.enumerate()) == threads and open_files() == before
