# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the robot's streams: what is encoded, sent, counted and reported."""
import dataclasses
import pathlib
import threading
import time
from typing import Any, List

import pytest
import rospy
from nav_msgs.msg import OccupancyGrid, Odometry
from polling import WAIT, wait_for
from robot_stream_case import Make, Recorder, logged, make, scan
from sensor_msgs.msg import LaserScan

from smokebot_udp.mission.settings import Settings
from smokebot_udp.monitoring.stages import read_sizes
from smokebot_udp.msg import ScanSegment
from smokebot_udp.nodes.trace import Trace
from smokebot_udp.streams.encoder import Encoded, LinkView, Sizing

__all__ = ['logged', 'make']


def test_a_message_goes_from_the_source_to_the_operator(make: Make) -> None:
    made = make()
    assert (made.segments.name, made.segments.message_class) == ('/smokebot_udp/scan/segments', ScanSegment)
    assert made.segments.options['subscriber_listener'] is made.stream
    assert (made.source.name, made.source.message_class, made.source.options['queue_size']) == ('/in', LaserScan, 8)
    for number in (5, 6):
        made.stream.receive(scan(number))
        wait_for(lambda number=number: number in made.segments.published)
    assert made.segments.published == [5, 6]
    wait_for(lambda: made.stream.sent == 2)     # the outbox, another thread, may be faster
    stats = made.stream.stats()
    assert (stats.messages_in, stats.messages_out, stats.problem) == (2, 2, None) and stats.enabled and stats.steady
    assert [one.peer for one in stats.connections] == ['/operator'] and not any(stats.dropped.values())
    assert made.stream.subscribers == {'/operator'}
    made.stream.close()
    assert made.segments.closed and made.source.closed


def test_the_newest_message_counts(make: Make) -> None:
    busy, free = threading.Event(), threading.Event()

    class Slow(Recorder):
        def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
            busy.set()
            assert free.wait(WAIT)
            return super().encode(message, settings, link)

    made = make(Slow)
    made.stream.receive(scan(1))
    assert busy.wait(WAIT)
    for number in (2, 3, 4):
        made.stream.receive(scan(number))
    free.set()
    wait_for(lambda: 4 in made.segments.published)
    assert [call[0] for call in made.stream.encoder.calls] == [1, 4]
    assert made.stream.stats().dropped['replaced'] == 2


def test_a_trace_says_what_decided_the_size_of_a_message(make: Make, tmp_path: pathlib.Path, monkeypatch: Any) -> None:
    monkeypatch.setattr('smokebot_udp.nodes.robot_stream.TRACE', Trace(str(tmp_path / 'trace')))

    class Sized(Recorder):
        def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
            sizing = Sizing('layered', 1500.0, 1400, 'room', 2.5) if len(message.ranges) > 5 else None
            return super().encode(message, settings, link)._replace(sizing=sizing)

    made = make(Sized)
    for number in (5, 6):
        made.stream.receive(scan(number, stamp=number))
        wait_for(lambda number=number: number in made.segments.published)
    said, = read_sizes((tmp_path / 'trace').read_text().splitlines(True))
    assert (said.stream, said.stamp, said[3:]) == ('scan', 6 * 10 ** 9, ('layered', 1500.0, 1400, 'room', 2.5))


def test_what_is_wrong_is_logged_and_the_next_message_goes(make: Make, logged: List[str]) -> None:
    made = make()
    made.stream.receive(scan(0, stamp=5))
    wait_for(lambda: logged)
    made.stream.receive(scan(3))
    wait_for(lambda: made.segments.published == [3])
    assert logged == ["stream 'scan': a message of /in is not sent: it has no ranges"]
    wait_for(lambda: made.stream.sent == 1)
    assert made.stream.stats().dropped['invalid'] == 1


def test_two_messages_of_one_stamp_cannot_be_told_apart(make: Make, logged: List[str]) -> None:
    made = make()
    made.stream.receive(scan(1, stamp=7))
    wait_for(lambda: made.segments.published == [1])
    made.stream.receive(scan(2, stamp=7))
    wait_for(lambda: logged)
    assert "its stamp is 7.000000000 like the last one's" in logged[0]
    made.stream.receive(scan(3, stamp=8))
    wait_for(lambda: made.segments.published == [1, 3])


def echo(number: int, frame_id: str, stamp: int) -> Any:
    message = scan(number, stamp)
    message.header.frame_id = frame_id
    return message


def test_messages_of_one_stamp_and_three_frames_all_go(make: Make, logged: List[str]) -> None:
    made = make(rate=10.0)
    for number, frame_id in enumerate(('first', 'last', '/strongest')):
        made.stream.receive(echo(number + 1, frame_id, 9))
    wait_for(lambda: sorted(made.segments.published) == [1, 2, 3])
    assert not logged and made.stream.stats().dropped['replaced'] == 0
    made.stream.receive(echo(7, 'strongest', 9))
    wait_for(lambda: logged)
    assert 'cannot be told apart' in logged[0]


def test_a_demand_is_of_all_sources_that_share_the_stream(make: Make) -> None:
    made = make(rate=10.0)
    made.stream.receive(scan(1))
    wait_for(lambda: made.segments.published)
    made.stream.encoder.message_size = 1000.0
    alone = made.stream.demand(time.monotonic()).points[-1].cost
    for frame_id in ('last', 'strongest'):
        made.stream.receive(echo(1, frame_id, 9))
    assert made.stream.demand(time.monotonic()).points[-1].cost == pytest.approx(3 * alone)


def arrivals_sent(made: Any, monkeypatch: Any) -> List[Any]:
    """The arrivals that cross with messages, as they are sent [s]."""
    sent: List[Any] = []

    def publish_frames(*frames: Any, limits: Any = None, second: Any = ()) -> int:
        sent.extend(frame.records['arrival']['secs'][0] for frame in frames)
        return 1
    monkeypatch.setattr(made.segments, 'publish_frames', publish_frames)
    return sent


def test_a_source_in_another_epoch_sends_when_its_messages_came(make: Make, logged: List[str], monkeypatch: Any
                                                                 ) -> None:
    made = make()
    sent = arrivals_sent(made, monkeypatch)
    for tick in range(10):
        monkeypatch.setattr(rospy.Time, 'now', lambda at=1000 + tick: rospy.Time(at, 0))
        made.stream.receive(scan(1, stamp=7 + tick))
        wait_for(lambda count=tick + 1: len(sent) == count)
    assert sent == [0] * 4 + [1000 + tick for tick in range(4, 10)]
    line, = logged
    assert line.startswith("stream 'scan', /in: frame '': its stamps are of another epoch, 993.0 s before they come:")


def test_a_source_that_repeats_its_stamp_for_good_is_named_once(make: Make, logged: List[str], monkeypatch: Any
                                                                 ) -> None:
    made = make()
    sent = arrivals_sent(made, monkeypatch)
    for tick in range(10):
        monkeypatch.setattr(rospy.Time, 'now', lambda at=10 + tick: rospy.Time(at, 0))
        made.stream.receive(scan(1, stamp=9))
        wait_for(lambda tick=tick: len(sent) == max(1, tick - 1))
    assert sent == [0] + [10 + tick for tick in range(3, 10)]
    assert len([line for line in logged if 'repeats its stamps' in line]) == 1


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
        time.sleep(0.02)    # the period of the source
    count, lasted = len(made.stream.encoder.calls), time.monotonic() - began
    assert 3 <= count <= 3 * lasted + 2


@pytest.mark.parametrize('backlog, waits', [(None, 0.02), (0.0, 0.0), (0.1, 0.1)])
def test_a_newer_message_waits_for_the_rest_as_the_encoder_says(make: Make, monkeypatch: Any, backlog: Any,
                                                               waits: float) -> None:
    class Waiting(Recorder):
        def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
            return super().encode(message, settings, link)._replace(backlog=backlog)

    made, asked = make(Waiting), []
    monkeypatch.setattr(made.link.outbox, 'await_rest', lambda *arguments: asked.append(arguments))
    made.stream.receive(scan(5))
    wait_for(lambda: made.segments.published == [5])
    assert asked == [('scan', False, waits)]


def test_an_encoder_that_foresees_knows_that_nothing_of_the_last_message_has_left(make: Make) -> None:
    class Foreseeing(Recorder):
        traits = dataclasses.replace(Recorder.traits, foresees=True)

        def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
            return super().encode(message, settings, link)._replace(backlog=0.0)

    made, unsent = make(Foreseeing), []
    made.link.outbox.change(lambda scheduler: scheduler.set_rate(1.0, time.monotonic()))
    for number in (1, 2, 3):    # a burst lets the first one go; the last one takes the place of the second
        made.stream.receive(scan(number))
        wait_for(lambda number=number: made.stream.sent == number)
        unsent.append(made.stream.encoder.seen.unsent)
        wait_for(lambda: made.segments.published == [1])
    assert unsent == [False, False, True] and made.stream.stats().dropped['datagrams of replaced messages'] == 1


def test_a_stream_that_is_turned_off_stops_in_the_middle(make: Make) -> None:
    made = make()
    made.link.outbox.change(lambda scheduler: scheduler.set_rate(1.0, time.monotonic()))
    made.stream.receive(scan(1))        # a burst lets it go
    wait_for(lambda: made.segments.published == [1])
    made.stream.receive(scan(2))
    wait_for(lambda: made.link.outbox.sending('scan'))
    made.stream.settings.request({'enabled': False})
    assert not made.link.outbox.sending('scan') and made.stream.stats().dropped['datagrams of replaced messages'] == 1


# what the link controller asks

def test_a_demand_is_of_the_source_where_that_is_slower(make: Make) -> None:
    made = make(rate=50.0, min_bitrate=8.0, weight=2.0)
    assert made.stream.demand(0.0) is None      # nothing was encoded yet
    made.stream.encoder.message_size = 1000
    for step in range(30):
        made.stream.received = step     # ten a second
        demand = made.stream.demand(0.1 * step)
    assert demand.rate == pytest.approx(10.0, rel=0.05) and demand.weight == 2.0 and demand.min_bitrate == 1000.0
    assert demand.points[-1].cost == pytest.approx(1000 * demand.rate)
    assert demand.refine({'rate': 3.0}, 100.0) == {'rate': 3.0}
    made.stream.receive(scan(5))
    wait_for(lambda: made.segments.published)
    assert made.stream.encoder.seen.source_rate == demand.rate
    made.segments.listeners = 0
    assert made.stream.demand(3.1) is None


def test_a_demand_includes_what_the_transport_adds(make: Make) -> None:
    made = make(rate=10.0)
    made.stream.encoder.message_size = 1500
    plain = made.stream.demand(0.0)
    made.link.transport.overhead = 150      # of the 1472 + 28 of each datagram
    assert made.link.expansion == pytest.approx(1.1)
    demand = made.stream.demand(0.0)
    assert [point.cost for point in demand.points] == pytest.approx([1.1 * point.cost for point in plain.points])
    assert [point.settings for point in demand.points] == [point.settings for point in plain.points]


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
