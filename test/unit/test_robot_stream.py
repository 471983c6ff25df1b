# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the robot's streams, with stand-ins for rospy's topics and an encoder that keeps what it is given."""
import threading
import time
from types import SimpleNamespace
from typing import Any, Callable, Iterator, List, Mapping, Optional, Sequence

import pytest
import rospy
from genpy import Time
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan, PointCloud2

from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import GridSegment, ScanSegment
from smokebot_udp.nodes.outbox import Outbox
from smokebot_udp.nodes.robot_stream import RobotLink, RobotStream
from smokebot_udp.streams.encoder import Encoder
from smokebot_udp.streams.held import Holding
from smokebot_udp.streams.parameters import ROBOT
from smokebot_udp.udpros.frame import Frame

WAIT = 10.0     # longer than any of it takes [s]


def wait_for(condition: Callable[[], Any]) -> None:
    until = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.002)


class Topic:
    """Stands in for publishers and subscribers of rospy."""

    def __init__(self, name: str, message_class: Any, *args: Any, **options: Any) -> None:
        self.name, self.message_class, self.args, self.options = name, message_class, args, options
        self.listeners, self.seq, self.impl, self.closed = 1, 0, self, False
        self.published: List[Any] = []
        self.peer = '/operator'

    def get_num_connections(self) -> int:
        return self.listeners

    def publish(self, message: Any) -> None:
        self.published.append(message)
        self.seq += 1

    def publish_frames(self, *frames: Any, limits: Any = None) -> int:
        first = self.seq + 1
        for frame in frames:
            number = 'total' if frame.message_class is ScanSegment else 'index'
            self.published += [frame.records[number][row].item() for row in range(len(frame))]
            self.seq += len(frame)
        return first

    def connections(self) -> List[Any]:
        return [{'peer': self.peer, 'address': ('10.0.0.2', 5), 'datagrams': 1, 'bytes': 99}] * self.listeners

    def unregister(self) -> None:
        self.closed = True


class Recorder(Encoder[Any]):
    """Writes a scan's number of ranges into a frame, and keeps what it is asked."""
    MESSAGE, SEGMENTS = LaserScan, {'segments': ScanSegment}
    PARAMETERS: Mapping[str, Parameter] = {**ROBOT, 'repeat_rate': Parameter(20.0, 'Hz', '', above=0.0, live=True)}

    def __init__(self, settings: Mapping[str, Any]) -> None:
        super().__init__(settings)
        self.calls: List[Any] = []

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        if settings['weight'] > 100:
            raise ValueError('weight is %g' % settings['weight'])

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Any]:
        self.calls.append((len(message.ranges), settings['rate'], max_datagram_size))
        if not message.ranges:
            raise ValueError('it has no ranges')
        return [self._frame(len(message.ranges))]

    @staticmethod
    def _frame(number: int) -> Frame:
        frame = Frame(ScanSegment, 1, {})
        frame.records['total'] = number
        return frame


class Keeper(Recorder):
    """As maps: kept for late subscribers, encoded again, repeated."""
    STAMPED, KEEPS, REENCODES = False, True, True
    number: Optional[int] = None

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Any]:
        before, self.number = self.number, len(message.ranges)
        self.calls.append(self.number)
        return [] if self.number == before else [self._frame(self.number)]

    def repeat_period(self, settings: Settings) -> Optional[float]:
        return 1.0 / float(settings['repeat_rate'])

    def repeat(self, settings: Settings, max_datagram_size: int) -> Sequence[Any]:
        return [self._frame(100 + (self.number or 0))]


class TwoParts(Recorder):
    """Sends scans of more than 10 ranges on another part, where that may be and all receive it."""
    SEGMENTS = {'segments': ScanSegment, 'layers': GridSegment}
    PARAMETERS = {**ROBOT, 'coding': Parameter('interleaved', '', '', live=True)}

    def parts(self, settings: Settings) -> Sequence[str]:
        return ['segments'] if settings['coding'] == 'interleaved' else ['segments', 'layers']

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Any]:
        number = len(message.ranges)
        self.message_size = 1000
        if number <= 10 or not self.heard('layers'):
            return [self._frame(number)]
        frame = Frame(GridSegment, 1, {})
        frame.records['index'] = number
        return [frame]


class Deriver(Recorder):
    MESSAGE, DERIVED = PointCloud2, LaserScan
    PARAMETERS = {**ROBOT, 'scan_topic': Parameter('', '', '')}

    def derive(self, message: Any, settings: Settings) -> Any:
        return LaserScan(ranges=[0.0] * message.width)


class Protected(Recorder):
    """Sends scans at once until one has 100 ranges."""
    PROTECTED, STAMPED, QUEUE_SIZE = True, False, 100

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Any]:
        self.calls.append(max_datagram_size)
        self.warnings.append('half of it is missing')
        self.PROTECTED = self.PROTECTED and len(message.ranges) < 100
        self.message_size = 1000
        return [self._frame(len(message.ranges))] * 2


Make = Callable[..., Any]


@pytest.fixture
def logged(monkeypatch: Any) -> List[str]:
    """What is logged as warnings and errors."""
    lines: List[str] = []
    for name in ('logwarn_throttle_identical', 'logerr_throttle_identical'):
        monkeypatch.setattr(rospy, name, lambda period, line: lines.append(line))
    monkeypatch.setattr(rospy, 'logwarn', lambda line, *args: lines.append(line % args))
    monkeypatch.setattr(rospy, 'is_shutdown', lambda: False)
    return lines


@pytest.fixture
def make(logged: List[str]) -> Iterator[Make]:
    """Makes a stream that is started: its link, its topics as `segments` and `local`, its source's as `source`."""
    made = []

    def make_one(kind: Any = Recorder, **changes: Any) -> Any:
        settings = {**{name: parameter.default for name, parameter in kind.PARAMETERS.items()}, 'robot_topic': '/in',
                    'rate': 1000.0, **changes}
        link = RobotLink(1472, Outbox())
        link.outbox.start()
        topics: List[Topic] = []

        def topic(*args: Any, **options: Any) -> Topic:
            topics.append(Topic(*args, **options))
            return topics[-1]

        def named(name: str) -> Any:
            return next((one for one in topics if one.name == name), None)

        stream = RobotStream('scan', settings, kind(settings), link, topic, topic, topic)
        stream.start()
        made.append((stream, link))
        return SimpleNamespace(stream=stream, link=link, segments=topics[0], local=topics[1] if kind.DERIVED else None,
                               source=topics[-1], topics=topics, named=named)

    yield make_one
    for stream, link in made:
        stream.close()
        link.outbox.stop()


def scan(number: int, stamp: Optional[int] = None) -> Any:
    message = LaserScan(ranges=[0.0] * number)
    message.header.stamp = Time(number if stamp is None else stamp, 0)
    return message


def test_a_message_goes_from_the_source_to_the_operator(make: Make) -> None:
    made = make()
    assert (made.segments.name, made.segments.message_class) == ('/smokebot_udp/scan/segments', ScanSegment)
    assert made.segments.options['max_datagram_size'] == 1472
    assert (made.source.name, made.source.message_class, made.source.options['queue_size']) == ('/in', LaserScan, 1)
    for number in (5, 6):
        made.stream.receive(scan(number))
        wait_for(lambda number=number: number in made.segments.published)
    assert made.segments.published == [5, 6]
    stats = made.stream.stats()
    assert (stats.messages_in, stats.messages_out, stats.problem) == (2, 2, None) and stats.enabled and stats.steady
    assert [one.peer for one in stats.connections] == ['/operator'] and not any(stats.dropped.values())
    assert made.stream.subscribers == {'/operator'}
    made.stream.close()
    assert made.segments.closed and made.source.closed


def test_the_newest_message_counts(make: Make) -> None:
    busy, free = threading.Event(), threading.Event()

    class Slow(Recorder):
        def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Any]:
            busy.set()
            assert free.wait(WAIT)
            return super().encode(message, settings, max_datagram_size)

    made = make(Slow)
    made.stream.receive(scan(1))
    assert busy.wait(WAIT)
    for number in (2, 3, 4):
        made.stream.receive(scan(number))
    free.set()
    wait_for(lambda: 4 in made.segments.published)
    assert [call[0] for call in made.stream.encoder.calls] == [1, 4]
    assert made.stream.stats().dropped['replaced'] == 2


def test_what_is_wrong_is_logged_and_the_next_message_goes(make: Make, logged: List[str]) -> None:
    made = make()
    made.stream.receive(scan(0, stamp=5))
    wait_for(lambda: logged)
    made.stream.receive(scan(3))
    wait_for(lambda: made.segments.published == [3])
    assert logged == ["stream 'scan': a message of /in is not sent: it has no ranges"]
    assert made.stream.stats().dropped['invalid'] == 1 and made.stream.sent == 1


def test_two_messages_of_one_stamp_cannot_be_told_apart(make: Make, logged: List[str]) -> None:
    made = make()
    made.stream.receive(scan(1, stamp=7))
    wait_for(lambda: made.segments.published == [1])
    made.stream.receive(scan(2, stamp=7))
    wait_for(lambda: logged)
    assert "its stamp is 7.000000000 like the last one's" in logged[0]
    made.stream.receive(scan(3, stamp=8))
    wait_for(lambda: made.segments.published == [1, 3])


def test_a_message_without_a_stamp_gets_the_time_of_now(make: Make, monkeypatch: Any) -> None:
    monkeypatch.setattr(rospy.Time, 'now', lambda: rospy.Time(9, 5))
    made, message = make(), scan(1, stamp=0)
    made.stream.receive(message)
    wait_for(lambda: made.segments.published)
    assert message.header.stamp == rospy.Time(9, 5)


def test_nothing_is_encoded_for_nobody(make: Make) -> None:
    made = make()
    for change in ('listeners', 'enabled', 'paused'):
        made.segments.listeners = int(change != 'listeners')
        made.stream.settings.request({'enabled': change != 'enabled'})
        made.stream.settings.grant(None if change == 'paused' else {})
        assert not made.stream.wanted and made.stream.heard == (change != 'listeners')
        made.stream.receive(scan(1))
    made.stream.settings.grant({})
    made.stream.receive(scan(2))
    wait_for(lambda: made.segments.published == [2])
    assert [call[0] for call in made.stream.encoder.calls] == [2] and made.stream.received == 4


def test_a_paused_stream_says_why(make: Make) -> None:
    made = make()
    made.stream.settings.grant(None)
    assert 'too slow' in made.stream.stats().problem and made.stream.demand(0.0) is None
    made.stream.settings.grant({})
    assert made.stream.stats().problem is None


def test_settings_and_shorter_datagrams_count_from_the_next_message_on(make: Make) -> None:
    made = make()
    made.stream.settings.grant({'rate': 500.0})
    made.link.datagram_size = 736
    made.stream.receive(scan(1))
    wait_for(lambda: made.segments.published)
    assert made.stream.encoder.calls == [(1, 500.0, 736)] and made.stream.stats().rate == 500.0


def test_settings_that_contradict_each_other_are_refused(make: Make) -> None:
    with pytest.raises(ValueError, match='weight is 101'):
        make(weight=101.0)
    made = make()
    with pytest.raises(ValueError, match='weight is 102'):
        made.stream.settings.request({'weight': 102.0})
    assert made.stream.settings.current['weight'] == 1.0


def test_grants_that_differ_in_their_last_digits_let_no_more_through(make: Make) -> None:
    """Where each grant made a new RateLimiter, the first message of each left at once."""
    made = make()
    made.stream.settings.grant({'rate': 3.0})
    began = time.monotonic()
    for number in range(1, 101):
        made.stream.settings.grant({'rate': 3.0 + 1e-9 * number})
        made.stream.receive(scan(number))
        time.sleep(0.02)
    lasted = time.monotonic() - began
    assert 3 <= len(made.stream.encoder.calls) <= 3 * lasted + 2


# messages that are kept and repeated

def test_what_came_before_its_listener_is_sent_to_it_at_once(make: Make) -> None:
    made = make(Keeper, repeat_rate=0.001)
    made.segments.listeners = 0
    made.stream.receive(scan(5))
    wait_for(lambda: made.stream.encoder.calls)
    time.sleep(0.05)
    assert made.segments.published == []
    made.segments.listeners = 1
    made.stream.peer_subscribe('segments', None, None)
    wait_for(lambda: made.segments.published == [105])


def test_an_unchanged_message_is_repeated_and_a_changed_one_goes_at_once(make: Make) -> None:
    made = make(Keeper, repeat_rate=50.0)
    made.stream.receive(scan(5))
    wait_for(lambda: made.segments.published[:3] == [5, 105, 105])
    made.stream.settings.request({'repeat_rate': 0.001})
    made.stream.receive(scan(6))
    wait_for(lambda: 6 in made.segments.published)
    time.sleep(0.05)
    assert made.segments.published[-1] == 6
    made.stream.settings.grant({'repeat_rate': 50.0})       # counts for the next repeat already
    wait_for(lambda: 106 in made.segments.published)


def test_other_settings_encode_the_last_message_again(make: Make) -> None:
    made = make(Keeper, repeat_rate=0.001)
    made.stream.receive(scan(5))
    wait_for(lambda: made.segments.published == [5])
    made.stream.settings.grant({'repeat_rate': 0.002})
    wait_for(lambda: made.stream.encoder.calls == [5, 5])
    made.stream.settings.grant({'repeat_rate': 0.002})      # no change
    time.sleep(0.05)
    assert made.stream.encoder.calls == [5, 5] and made.segments.published == [5]


def test_nothing_is_repeated_while_it_is_still_leaving(make: Make) -> None:
    made = make(Keeper, repeat_rate=100.0)
    made.link.outbox.change(lambda scheduler: scheduler.set_rate(1.0))      # 1 byte/s
    made.stream.receive(scan(5))        # a burst lets it go
    wait_for(lambda: made.segments.published == [5])
    wait_for(lambda: made.link.outbox.sending('scan'))
    time.sleep(0.1)
    assert made.link.outbox.dropped('scan') == 0        # one repeat waits, and no other replaced it


def test_a_stream_that_is_turned_off_stops_in_the_middle(make: Make) -> None:
    made = make()
    made.link.outbox.change(lambda scheduler: scheduler.set_rate(1.0))
    made.stream.receive(scan(1))        # a burst lets it go
    wait_for(lambda: made.segments.published == [1])
    made.stream.receive(scan(2))
    wait_for(lambda: made.link.outbox.sending('scan'))
    made.stream.settings.request({'enabled': False})
    assert not made.link.outbox.sending('scan') and made.stream.stats().dropped['datagrams of replaced messages'] == 1


# streams of several parts

LAYERS = '/smokebot_udp/scan/layers'


def test_a_part_is_advertised_when_it_is_first_needed_and_stays(make: Make) -> None:
    made = make(TwoParts)
    made.stream.receive(scan(11))
    wait_for(lambda: made.segments.published == [11])
    assert made.named(LAYERS) is None
    made.stream.settings.request({'coding': 'auto'})
    made.stream.receive(scan(12))
    wait_for(lambda: made.named(LAYERS) and made.named(LAYERS).published == [12])
    layers = made.named(LAYERS)
    assert layers.message_class is GridSegment and layers.options['max_datagram_size'] == 1472
    made.stream.settings.request({'coding': 'interleaved'})
    for number in (3, 13):
        made.stream.receive(scan(number))
        wait_for(lambda number=number: number in made.segments.published + layers.published)
    assert layers.published == [12, 13] and len([one for one in made.topics if one.name == LAYERS]) == 1
    assert made.stream.stats().messages_out == 4 and [
        one.name for one in made.stream.stats().connections] == ['scan', 'scan/layers']
    made.stream.close()
    assert layers.closed and made.segments.closed


def test_a_part_counts_as_heard_only_where_every_operator_receives_it(make: Make) -> None:
    made = make(TwoParts, coding='auto')
    layers = made.named(LAYERS)
    layers.listeners = 0            # the operator is about to subscribe
    made.stream.receive(scan(11))
    wait_for(lambda: made.segments.published == [11])
    layers.listeners, layers.peer = 1, '/desk2'
    made.stream.receive(scan(12))
    wait_for(lambda: made.segments.published == [11, 12])
    assert made.stream.subscribers == {'/operator', '/desk2'}
    layers.peer = '/operator'
    made.stream.receive(scan(13))
    wait_for(lambda: layers.published == [13])
    made.segments.listeners = 0     # somebody wants nothing but layers
    made.stream.receive(scan(14))
    wait_for(lambda: layers.published == [13, 14])
    assert made.stream.heard and made.stream.demand(0.0) is not None
    layers.listeners = 0
    assert not made.stream.heard and not made.stream.subscribers


# messages that are sent little by little, until operators hold them

class Counting(Recorder):
    """Counts down to 0, one datagram each 10 ms, from what operators report; a further topic sets the count."""
    STAMPED, KEEPS = False, True

    def __init__(self, settings: Mapping[str, Any]) -> None:
        super().__init__(settings)
        self.left = 0

    def sources(self, settings: Mapping[str, Any]) -> Mapping[str, Any]:
        return {'/more': Odometry}

    def merge(self, waiting: Optional[Any], message: Any) -> Optional[Any]:
        if message._type == LaserScan._type:
            return message
        if message.header.seq > 5:
            raise ValueError('it is too much')
        return None

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Any]:
        self.left = len(message.ranges)
        return self.repeat(settings, max_datagram_size)     # type: ignore[return-value]

    def repeat_period(self, settings: Settings) -> Optional[float]:
        return 0.01 if self.left else 1000.0

    def repeat(self, settings: Settings, max_datagram_size: int) -> Sequence[Any]:
        self.left -= 1
        return [self._frame(self.left)]

    def held(self, operator: str, holding: Holding) -> None:
        self.calls.append(operator)
        self.left = holding.session


def test_repeats_follow_the_period_that_the_encoder_wants_now(make: Make) -> None:
    made = make(Counting)
    made.stream.receive(scan(3))
    wait_for(lambda: made.segments.published == [2, 1, 0])
    assert made.stream.held('/operator', Holding(2, ()))
    wait_for(lambda: made.segments.published == [2, 1, 0, 1, 0])
    assert not made.stream.held('/stranger', Holding(9, ())) and made.stream.encoder.calls == ['/operator']


def test_messages_of_further_topics_are_merged(make: Make, logged: List[str]) -> None:
    made = make(Counting)
    more = made.named('/more')
    assert more.message_class is Odometry and made.named('/in').message_class is LaserScan
    receive = more.args[0]
    message = Odometry()
    receive(message)
    message.header.seq = 6
    receive(message)
    receive(scan(1))
    assert made.segments.published == [] and logged == [
        "stream 'scan': a message of /more is not sent: it is too much",
        "stream 'scan': a message of /more is not sent: it is sensor_msgs/LaserScan, must be nav_msgs/Odometry"]
    made.stream.close()
    assert more.closed


# messages made on the robot

def cloud(number: int) -> Any:
    message = PointCloud2(width=number)
    message.header.stamp = Time(number, 0)
    return message


def test_derived_messages_are_published_at_the_requested_rate_and_sent_at_the_granted_one(make: Make) -> None:
    made = make(Deriver)
    assert (made.local.name, made.local.message_class) == ('scan', LaserScan)
    made.stream.settings.grant({'rate': 0.001})
    for number in range(1, 6):
        made.stream.settings.grant({'rate': 0.001 + 1e-9 * number})
        made.stream.receive(cloud(number))
        wait_for(lambda number=number: len(made.local.published) == number)
    time.sleep(0.05)
    assert [len(message.ranges) for message in made.local.published] == [1, 2, 3, 4, 5]
    assert 1 <= len(made.segments.published) <= 2       # one period of slack absorbs jitter


def test_derived_messages_need_no_operator(make: Make) -> None:
    made = make(Deriver, scan_topic='/obstacles')
    assert made.local.name == '/obstacles'
    made.segments.listeners = 0
    made.stream.receive(cloud(1))
    wait_for(lambda: made.local.published)
    made.local.listeners = 0
    made.stream.receive(cloud(2))
    time.sleep(0.05)
    assert len(made.local.published) == 1 and made.stream.sent == 0


# protected streams

def test_protected_messages_leave_at_once(make: Make, logged: List[str]) -> None:
    made = make(Protected)
    assert made.source.options['queue_size'] == 100
    made.link.datagram_size = 736
    made.link.outbox.change(lambda scheduler: scheduler.set_rate(1.0))
    for number in (5, 6):
        made.stream.receive(scan(number))
        wait_for(lambda number=number: made.segments.published[-2:] == [number] * 2)
    wait_for(lambda: len(logged) == 2)
    assert made.stream.encoder.calls == [1472, 1472] and made.stream.sent == 4
    assert logged == ["stream 'scan', /in: half of it is missing"] * 2
    assert made.link.outbox.protected > 0 and made.stream.demand(0.0) is None


def test_a_stream_that_is_no_longer_protected_has_a_share_of_the_link(make: Make) -> None:
    made = make(Protected)
    made.link.datagram_size = 736
    for number in (100, 5):
        made.stream.receive(scan(number))
        wait_for(lambda number=number: made.segments.published[-2:] == [number] * 2)
    assert made.stream.encoder.calls == [1472, 736] and made.link.outbox.protected == 0
    wait_for(lambda: made.stream.sent == 2)
    assert made.stream.demand(0.0).points[-1].cost == 1000 * made.stream.settings.current['rate']


# what the link controller asks

def test_a_demand_is_of_the_source_where_that_is_slower(make: Make) -> None:
    made = make(rate=50.0, min_bitrate=8.0, weight=2.0)
    assert made.stream.demand(0.0) is None      # nothing was encoded yet
    made.stream.encoder.message_size = 1000
    for step in range(30):
        made.stream.received = step     # ten a second
        demand = made.stream.demand(0.1 * step)
    assert demand.rate == pytest.approx(10.0, rel=0.05) and demand.weight == 2.0 and demand.min_bitrate == 1000.0
    assert made.stream.encoder.source_rate == demand.rate
    assert demand.points[-1].cost == pytest.approx(1000 * demand.rate)
    assert demand.refine({'rate': 3.0}, 100.0) == {'rate': 3.0}
    made.segments.listeners = 0
    assert made.stream.demand(3.1) is None


def test_a_message_of_another_kind_does_not_end_the_thread(make: Make, logged: List[str]) -> None:
    made = make()
    made.stream.receive(OccupancyGrid())        # it has no ranges at all
    wait_for(lambda: logged)
    made.stream.receive(scan(1))
    wait_for(lambda: made.segments.published == [1])


def test_a_message_of_another_type_is_reported_and_not_encoded(make: Make, logged: List[str]) -> None:
    made = make()
    made.stream.receive(Odometry())
    made.stream.receive(scan(5))
    wait_for(lambda: made.segments.published)
    assert made.segments.published == [5]
    assert logged == ["stream 'scan': a message of /in is not sent: it is nav_msgs/Odometry, must be "
                      "sensor_msgs/LaserScan"]
    stats = made.stream.stats()
    assert (stats.messages_in, stats.dropped['invalid']) == (1, 1)
