# SPDX-License-Identifier: BSD-3-Clause
"""The nodes around the link controller, without ROS: messages, and what a plan does to streams and outbox."""
import math
from types import SimpleNamespace
from typing import Any, Dict, List, Mapping

import pytest
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from stub_transport import StubTransport

from smokebot_udp.congestion.controller import PLANNING_SHARE, Controller, Demand, Plan
from smokebot_udp.congestion.estimator import Limits
from smokebot_udp.congestion.feedback import ArrivalSample, ReceiveHistory, Report, StreamArrivals
from smokebot_udp.congestion.operating_points import OperatingPoint
from smokebot_udp.congestion.packet_scheduler import PacketScheduler
from smokebot_udp.mission.parameters import check
from smokebot_udp.monitoring.stats import LinkStats
from smokebot_udp.monitoring.wifi import WifiState
from smokebot_udp.msg import LinkReport
from smokebot_udp.nodes import link_control, link_reporter
from smokebot_udp.nodes.link_control import UNPACED, LinkControl, SharedController, as_message, grant
from smokebot_udp.nodes.outbox import Outbox
from smokebot_udp.nodes.robot_sender import RUNNERS
from smokebot_udp.nodes.robot_stream import RobotLink, RobotStream
from smokebot_udp.streams import encoder_class
from smokebot_udp.units import MBIT


@pytest.fixture
def ros(monkeypatch: Any) -> Any:
    """What ROS does for a LinkControl: `published` has its messages, and the test calls `report` and `tick`."""
    ros = SimpleNamespace(published=[])

    def subscriber(topic: str, kind: Any, callback: Any, **_: Any) -> Any:
        ros.report = callback
        return SimpleNamespace(unregister=lambda: None)

    def worker(name: str, work: Any, log: Any, period: float) -> Any:
        ros.tick = work
        return SimpleNamespace(start=lambda: None, close=lambda: None, wake=lambda: None)
    monkeypatch.setattr(rospy, 'Publisher', lambda *_, **__: SimpleNamespace(
        publish=ros.published.append, unregister=lambda: None))
    monkeypatch.setattr(rospy.Time, 'now', lambda: rospy.Time(1))
    ros.transport = StubTransport(subscriber=subscriber)
    monkeypatch.setattr(link_control, 'PeriodicWorker', worker)
    return ros


def stream(kind: str, link: RobotLink, **settings: Any) -> RobotStream:
    """A RobotStream that is not started: nobody listens to it."""
    class_ = encoder_class(kind)
    checked = check({'robot_topic': '/source', **settings}, class_.PARAMETERS)
    return RUNNERS.get(kind, RobotStream)('unnamed', checked, class_(checked), link)


def effective(streams: Mapping[str, RobotStream], *names: str) -> Dict[str, List[Any]]:
    return {name: [one.settings.current[setting] for setting in names] for name, one in streams.items()}


def test_a_report_is_a_message() -> None:
    report = Report(5, 123456, [StreamArrivals('thermal', 9, 8, 7777)], [ArrivalSample(0, 9, 1234)])
    message = link_reporter.as_message(report)
    assert isinstance(message, LinkReport) and (message.session, message.clock) == (5, 123456)
    assert [(one.name, one.highest, one.received, one.bytes) for one in message.streams] == [('thermal', 9, 8, 7777)]
    assert [(mark.stream, mark.seq, mark.age) for mark in message.marks] == [(0, 9, 1234)]


def test_operators_are_the_subscribers_of_the_streams(ros: Any, monkeypatch: Any) -> None:
    controller, told = Controller(Limits(), True, 1472), []
    monkeypatch.setattr(controller, 'on_operators', lambda connections, now: told.append(dict(connections)))
    shared = SharedController(controller)
    link = RobotLink(ros.transport, Outbox(PacketScheduler(), shared.on_sent))
    streams = {'thermal': stream('image', link), 'lidar': stream('cloud', link), 'off': stream('scan', link)}
    peers = {id(streams['thermal']): {'/desk', '/desk2'}, id(streams['lidar']): {'/desk'}}
    monkeypatch.setattr(RobotStream, 'subscribers', property(lambda one: peers.get(id(one), set())))
    LinkControl(shared, link, streams)
    ros.tick()
    peers[id(streams['thermal'])].remove('/desk2')
    ros.tick()
    assert told == [{'/desk': 2, '/desk2': 1}, {'/desk': 2}]
    peers[id(streams['off'])] = {'/late'}
    streams['off'].peer_subscribe('', None, None)       # at once, before it is sent much
    assert told[2:] == [{'/desk': 2, '/late': 1}]


@pytest.mark.parametrize('rate, pace', [(UNPACED, UNPACED), (1.01 * UNPACED, None), (None, None)])
def test_a_link_that_is_faster_than_any_radio_is_not_paced(rate: Any, pace: Any, ros: Any,
                                                           monkeypatch: Any) -> None:
    controller = Controller(Limits(), True, 1472)
    monkeypatch.setattr(controller, 'rate', lambda now: rate)
    shared = SharedController(controller)
    link = RobotLink(ros.transport, Outbox(PacketScheduler(), shared.on_sent))
    LinkControl(shared, link, {})
    ros.tick()
    assert link.outbox.rate == pace


@pytest.mark.parametrize('changes, state', [
    ({}, 'as /op reports'), ({'timeout': True, 'silence': 11.96}, 'no reports of /op for 12.0 s'),
    ({'slower': {'/op3': 1e5, '/op2': 2e5}}, 'as /op reports, less for /op2, /op3'),
    ({'operator': None}, 'no operator has reported yet'), ({'adaptive': False}, 'fixed'),
])
def test_the_status_message_says_what_the_rate_depends_on(changes: Dict[str, Any], state: str) -> None:
    known = {'adaptive': True, 'rate': 2 * MBIT, 'sent': MBIT, 'wanted': 30 * MBIT, 'operator': '/op', 'silence': 0.1}
    assert as_message(LinkStats(**{**known, **changes}), WifiState()).state == state


def test_the_status_message_has_its_own_units() -> None:
    known = LinkStats(True, 2 * MBIT, MBIT, 30 * MBIT, 2.5 * MBIT, 0.05, 0.01, 0.04)
    status = as_message(known, WifiState('wlan0', 'net', -60.0, rx_bitrate=6.5))
    assert (status.rate, status.sent, status.wanted, status.capacity) == (2.0, 1.0, 30.0, 2.5)
    assert (status.loss, status.queue_delay, status.round_trip) == (0.05, 0.01, 0.04)
    assert (status.wifi.interface, status.wifi.ssid, status.wifi.signal, status.wifi.rx_bitrate) == (
        'wlan0', 'net', -60.0, 6.5)
    assert math.isnan(status.wifi.noise)
    assert as_message(LinkStats(True, None, 0.0, 0.0), WifiState()).rate == 0        # unlimited


def test_a_plan_reaches_the_streams() -> None:
    link = RobotLink(StubTransport(), Outbox())
    odometry = {'message_type': 'nav_msgs/Odometry', 'repeat_rate': 1.0}
    streams = {'thermal': stream('image', link), 'lidar': stream('cloud', link), 'off': stream('scan', link),
               'odom': stream('relay', link, rate=10.0, **odometry), 'gas': stream('relay', link, rate=0.5, **odometry)}
    assert streams['odom'].encoder.MESSAGE is Odometry and streams['off'].encoder.MESSAGE._type == LaserScan._type
    grant(Plan(1e5, 736, {'thermal': 1e4}, {'thermal': {'rate': 5.0}, 'lidar': None}, 0.25), streams)
    assert effective(streams, 'rate') == {'thermal': [5.0], 'lidar': [10.0], 'off': [10.0], 'odom': [2.5], 'gas': [0.5]}
    assert {name for name, one in streams.items() if one.settings.current.paused} == {'lidar'}
    relays = {name: streams[name] for name in ('odom', 'gas')}
    assert effective(relays, 'repeat_rate') == {'odom': [0.25], 'gas': [0.25]}
    grant(Plan(None, 1472, {}, {}, 1.0), streams)
    assert {one.settings.current['rate'] for one in streams.values()} == {10.0, 0.5}
    assert not any(one.settings.current.paused for one in streams.values())


def test_a_relay_takes_no_more_than_its_share_of_the_link() -> None:
    link = RobotLink(StubTransport(), Outbox())
    streams = {'link': stream('relay', link, rate=2.0, message_type='nav_msgs/Odometry', max_share=0.01),
               'odom': stream('relay', link, rate=2.0, message_type='nav_msgs/Odometry')}
    plan, fast = Plan(1e5, 736, {}, {}, 1.0), Plan(1e5, 736, {}, {}, 0.25)
    grant(plan, streams, 1e4)
    assert effective(streams, 'rate') == {'link': [2.0], 'odom': [2.0]}     # how long its messages are is not known
    for one in streams.values():
        one.encoder.message_size = 100.0
    grant(plan, streams, 1e4)
    assert effective(streams, 'rate') == {'link': [1.0], 'odom': [2.0]}
    for capacity, rate in ((1e5, 2.0), (0.0, 2.0), (1.0, 0.2)):
        grant(plan, streams, capacity)
        assert effective(streams, 'rate') == {'link': [rate], 'odom': [2.0]}
    grant(fast, streams, 5e3)
    assert effective(streams, 'rate') == {'link': [0.5], 'odom': [1.0]}


def test_ticks_and_reports_set_the_rate_of_the_outbox(ros: Any, monkeypatch: Any) -> None:
    clock, published = SimpleNamespace(now=1000.0), ros.published
    monkeypatch.setattr(link_control, 'time', SimpleNamespace(monotonic=lambda: clock.now))
    scheduler, arrivals = PacketScheduler(), ReceiveHistory(lambda: 7)
    shared = SharedController(Controller(Limits(start_rate=5000.0, min_rate=4000.0), True, 1472))
    link = RobotLink(ros.transport, Outbox(scheduler, shared.on_sent))
    monkeypatch.setattr(RobotStream, 'subscribers', {'/op'})
    control, header = LinkControl(shared, link, {'thermal': stream('image', link)}), {'callerid': '/op'}
    ros.tick()
    assert scheduler.rate == 5000.0 and link.datagram_size == 736
    assert (published[-1].state, published[-1].rate) == ('no operator has reported yet', pytest.approx(0.04))

    for seq in range(1, 41):
        shared.on_sent('thermal', seq, 1, 1000, clock.now)
        clock.now += 0.05
        arrivals.add('thermal', seq, 1000, clock.now - 0.01)
        report = link_reporter.as_message(arrivals.report(clock.now))
        report._connection_header = header
        ros.report(report)
    assert scheduler.rate is not None and scheduler.rate > 10000
    ros.tick()
    assert published[-1].state == 'as /op reports' and not control.stats(clock.now).timeout
    for seq in range(41, 161):      # nothing is reported
        shared.on_sent('thermal', seq, 1, 1000, clock.now)
        clock.now += 0.1
        ros.tick()
    assert control.stats(clock.now).capacity == 4000.0 and scheduler.rate <= 4400.0
    assert control.stats(clock.now).state == 'no reports of /op for 12.0 s'


def test_encoders_know_what_reports_say_about_their_stream_whichever_part_is_sent(
        ros: Any, monkeypatch: Any) -> None:
    clock = SimpleNamespace(now=1000.0)
    monkeypatch.setattr(link_control, 'time', SimpleNamespace(monotonic=lambda: clock.now))
    monkeypatch.setattr(RobotStream, 'subscribers', {'/op'})
    shared, arrivals = SharedController(Controller(Limits(), True, 1472)), ReceiveHistory(lambda: 7)
    link = RobotLink(ros.transport, Outbox(PacketScheduler(), shared.on_sent))
    streams = {'thermal': stream('image', link), 'camera': stream('image', link)}
    LinkControl(shared, link, streams)
    ros.tick()
    assert not streams['thermal'].outlook.air.known
    header, seqs = {'callerid': '/op'}, {'thermal': 0, 'thermal/layers': 0, 'camera': 0}

    def second(name: str, lost: int) -> float:
        """Ten reports, each of ten datagrams of which some are lost: the loss that thermal expects."""
        for _ in range(10):
            for one, missing in ((name, lost), ('camera', 0)):
                shared.on_sent(one, seqs[one] + 1, 10, 1000, clock.now)
                for k in range(10):
                    if k >= missing:
                        arrivals.add(one, seqs[one] + 1 + k, 1000, clock.now + 0.01)
                seqs[one] += 10
            clock.now += 0.1
            report = link_reporter.as_message(arrivals.report(clock.now))
            report._connection_header = header
            ros.report(report)
        ros.tick()
        return streams['thermal'].outlook.loss(0.5)

    assert second('thermal', 0) < 0.02
    assert 0.2 < second('thermal', 3) < 0.45
    assert 0.2 < second('thermal/layers', 3) < 0.45     # what is known of the stream is known of its other part
    assert second('thermal/layers', 0) < 0.05
    assert streams['camera'].outlook.loss(0.5) < 0.02
    clock.now += 2.0
    ros.tick()
    assert not streams['thermal'].outlook.air.known     # no reports


def test_a_plan_says_what_a_stream_may_use_beside_the_others(ros: Any, monkeypatch: Any) -> None:
    controller = Controller(Limits(max_rate=1e5), False, 1472)
    points = [OperatingPoint({'rate': 1.0}, 1e4), OperatingPoint({'rate': 2.0}, 2e4)]
    plan = controller.tick(0.0, {'thermal': Demand(points), 'camera': Demand(points)}, 0)
    budget = PLANNING_SHARE * 1e5
    assert plan.rooms == {name: pytest.approx(budget - 2e4) for name in ('thermal', 'camera')}
    assert Controller(Limits(max_rate=math.inf), False, 1472).tick(0.0, {'thermal': Demand(points)}, 0).rooms == {}


@pytest.mark.parametrize('limits, adapt, known', [
    (Limits(start_rate=5000.0), True, 5000.0),         # nobody has reported yet
    (Limits(max_rate=8000.0), False, 8000.0), (Limits(max_rate=math.inf), False, 0.0)])
def test_what_is_sent_beside_the_streams_starves_nobody_while_the_capacity_is_unknown(
        limits: Limits, adapt: bool, known: float, ros: Any, monkeypatch: Any) -> None:
    """As a capture that begins before the first report."""
    monkeypatch.setattr(RobotStream, 'subscribers', {'/op'})
    monkeypatch.setattr(RobotStream, 'heard', True)
    scheduler, told = PacketScheduler(), []
    shared = SharedController(Controller(limits, adapt, 1472))

    def further(capacity: float) -> Dict[str, Demand]:
        told.append(capacity)
        points = [OperatingPoint({}, rate) for rate in (0.4 * capacity, max(0.4 * capacity, 1e5))]
        return {'capture': Demand(points, weight=0.0, min_bitrate=0.4 * capacity)}

    link = RobotLink(ros.transport, Outbox(scheduler, shared.on_sent))
    control = LinkControl(shared, link, {'thermal': stream('image', link)}, further=further)
    for _ in range(3):
        ros.tick()
    assert told == [0.0, known, known] and all(map(math.isfinite, control.shares.values()))
    for name in ('capture', 'thermal'):
        scheduler.put(name, name, [(2, 1000)])
    now, left = 1e6, []
    for _ in range(100):
        chunk = scheduler.take(now)
        left += [chunk.stream] if chunk else []
        now += 1.0
    assert set(left) == {'capture', 'thermal'} and scheduler.wait(now) == math.inf


def test_where_the_paths_carry_less_what_was_meant_for_more_does_not_leave(ros: Any, monkeypatch: Any) -> None:
    """As one of two paths is cut: the next image is as small as the other one needs it, and waits for nothing."""
    fell, scheduler = [False], PacketScheduler(1000.0)
    controller = Controller(Limits(max_rate=1e6), False, 1472)
    monkeypatch.setattr(controller, 'on_paths', lambda paths, now: fell[0])
    rooms = iter([1e6, 1e6, 1e5])
    monkeypatch.setattr(controller, 'tick', lambda *_: Plan(1e6, 1472, {}, {}, 1.0, {'thermal': next(rooms)}))
    shared = SharedController(controller)
    link = RobotLink(ros.transport, Outbox(scheduler, shared.on_sent))
    streams = {'thermal': stream('image', link), 'map': stream('grid', link),
               'odom': stream('relay', link, message_type='nav_msgs/Odometry')}
    LinkControl(shared, link, streams)
    for one in streams.values():
        one.name = next(name for name, other in streams.items() if other is one)
        scheduler.put(one.name, one.name, [(100, 1000)])
    ros.tick()
    ros.tick()
    assert streams['thermal'].outlook.room == pytest.approx(1e6 / link.expansion)
    assert all(map(scheduler.sending, streams))
    fell[0] = True
    ros.tick()
    assert streams['thermal'].outlook.room == pytest.approx(1e5 / link.expansion)
    assert [name for name in streams if scheduler.sending(name)] == ['map', 'odom']     # these are needed as a whole


def test_a_tick_does_not_undo_what_a_report_changes_meanwhile(ros: Any, monkeypatch: Any) -> None:
    scheduler, controller = PacketScheduler(), Controller(Limits(), True, 1472)
    shared, rates = SharedController(controller), [5000.0]
    monkeypatch.setattr(controller, 'rate', lambda now: rates[-1])
    LinkControl(shared, RobotLink(ros.transport, Outbox(scheduler, shared.on_sent)), {})
    # while the plan's grants are made, a report halves the rate
    monkeypatch.setattr(link_control, 'grant', lambda plan, streams, capacity: rates.append(plan.rate / 2))
    ros.tick()
    assert scheduler.rate == 2500.0
