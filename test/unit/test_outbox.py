# SPDX-License-Identifier: BSD-3-Clause
import threading
import time
from typing import Any, NoReturn

import pytest
from polling import WAIT, wait_for
from sensor_msgs.msg import LaserScan

from smokebot_udp.congestion.packet_scheduler import PacketScheduler
from smokebot_udp.monitoring.stages import read_marks
from smokebot_udp.nodes.outbox import Outbox
from smokebot_udp.nodes.trace import Trace
from smokebot_udp.nodes.worker import RETRY_PERIOD
from smokebot_udp.paths import STRAIGHT, Route
from smokebot_udp.udpros import Frame


class Publisher:
    """Keeps what it is given, and numbers it as udpros.Publisher does."""

    def __init__(self) -> None:
        self.sent, self.impl, self.limits = [], self, []
        self.seq = 0
        self._new = threading.Condition()

    def publish_frames(self, *frames, limits=None, second=()) -> Any:
        first = self.seq + 1
        self.published = time.monotonic()
        self.limits.append(limits)
        for frame in frames:
            with self._new:
                self.sent += frame.records['ranges'].ravel().tolist()
                self.seq += len(frame)
                self._new.notify_all()
        return first

    def wait_for(self, last) -> None:
        with self._new:
            assert self._new.wait_for(lambda: last in self.sent, WAIT)


@pytest.fixture
def make() -> Any:
    made = []

    def make_one(*args, **kwargs) -> Any:
        made.append(Outbox(*args, **kwargs))
        return made[-1]

    yield make_one
    for outbox in made:
        outbox.stop()


def frames(*lengths) -> Any:
    """Frames of so many messages, which hold 0, 1, 2, ..."""
    made, value = [], 0
    for length in lengths:
        made.append(Frame(LaserScan, length, {'ranges': 1}))
        made[-1].records['ranges'][:, 0] = range(value, value + length)
        value += length
    return made


def test_frames_leave_in_their_order_and_are_told_of(make) -> None:
    told, publisher = [], Publisher()
    outbox = make(PacketScheduler(1e6, burst=300), lambda *what: told.append(what))
    outbox.start()
    outbox.put('scan', publisher, frames(20, 3))
    publisher.wait_for(22)
    assert publisher.sent == list(range(23))
    outbox.stop()
    size = frames(1)[0].datagram_size + 28
    assert [what[:2] for what in told] == [('scan', first) for first in (1 + sum(t[2] for t in told[:i])
                                                                        for i in range(len(told)))]
    assert sum(what[2] for what in told) == 23 and {what[3] for what in told} == {size}
    assert len(told) > 5        # they were spread


def test_all_parts_of_a_stream_are_one_flow_and_are_recorded_by_their_names(make) -> None:
    told, asked, publisher, layers = [], [], Publisher(), Publisher()
    outbox = make(PacketScheduler(), lambda *what: told.append(what[:3]), route=(
        lambda stream, *_, **__: asked.append(stream) or STRAIGHT))
    outbox.put('scan', publisher, frames(4))        # not started: nothing leaves
    outbox.put('scan/layers', layers, frames(2))
    assert outbox.dropped('scan') == 4 and outbox.sending('scan')
    outbox.start()
    layers.wait_for(1)
    outbox.stop()
    assert told == [('scan/layers', 1, 2)] and asked == ['scan'] and publisher.sent == []


def test_a_message_for_one_subscriber_is_sent_to_no_other(make) -> None:
    publisher, told = Publisher(), []
    publisher.connections = lambda: [{'peer': peer} for peer in ('/a', '/b', '/c')]
    outbox = make(PacketScheduler(), lambda *what: told.append(what[5]), route=lambda *_: Route({'/a': 1, '/b': 1}))
    outbox.start()
    outbox.put('pieces', publisher, frames(2), only='/b')
    publisher.wait_for(1)
    outbox.stop()
    assert publisher.limits == [route.limits for route in told] == [{'/a': 0, '/b': 1, '/c': 0}]


def test_an_older_message_is_given_up(make) -> None:
    outbox, publisher, old, new = make(), Publisher(), frames(4), frames(2)     # not started: nothing leaves
    outbox.put('scan', publisher, old)
    assert outbox.sending('scan') and not outbox.sending('map')
    outbox.put('scan', publisher, new)
    assert outbox.sending('scan') and outbox.dropped('scan') == 4
    outbox.drop('scan')
    assert not outbox.sending('scan') and outbox.dropped('scan') == 6


def test_who_waits_until_a_message_has_left(make, monkeypatch) -> None:
    monkeypatch.setattr('smokebot_udp.nodes.outbox.MAX_WHOLE_WAIT', WAIT)   # a slow machine needs longer
    outbox, publisher = make(), Publisher()
    outbox.await_rest('scan')               # nothing is leaving
    outbox.put('scan', publisher, frames(3))
    threading.Timer(0.1, outbox.start).start()
    outbox.await_rest('scan')
    publisher.wait_for(2)
    outbox.change(lambda pace: pace.set_rate(1e3, time.monotonic()))
    long = frames(300)
    outbox.put('scan', publisher, long)
    outbox.await_rest('scan')               # that takes too long: the next one cuts it off
    assert outbox.sending('scan')
    threading.Timer(0.1, outbox.change, [lambda pace: pace.set_rate(1e6, time.monotonic())]).start()
    outbox.await_rest('scan', whole=True)
    assert not outbox.sending('scan')


def test_small_messages_do_not_wait(make) -> None:
    told, times, publisher = [], [], Publisher()

    def departed(*what) -> None:
        told.append(what[:4])
        times.append(what[4])
    outbox = make(PacketScheduler(1.0, burst=1), departed)      # 1 byte/s
    outbox.start()
    outbox.put('scan', publisher, frames(5))
    wait_for(lambda: told)      # one datagram has left; the next one leaves a minute later
    urgent, = frames(2)
    outbox.publish('gas', publisher, urgent)
    size = urgent.datagram_size + 28
    assert told[-1] == ('gas', publisher.seq - 1, 2, size) and outbox.protected == 2 * size
    assert times[-1] <= publisher.published     # else it would seem to arrive before it left


def test_a_stream_that_cannot_be_sent_stops_no_other(make) -> None:
    class Broken:
        def publish_frames(self, frame, limits, second) -> NoReturn:
            raise OSError('no way')

    told, publisher = [], Publisher()
    outbox = make(on_error=lambda stream, error: told.append((stream, str(error))))
    outbox.put('broken', Broken(), frames(3))
    outbox.put('scan', publisher, frames(3))
    outbox.start()
    publisher.wait_for(2)
    assert told == [('broken', 'no way')]


def test_a_new_rate_counts_at_once(make) -> None:
    outbox, publisher = make(PacketScheduler(1.0, burst=1)), Publisher()
    outbox.start()
    outbox.put('scan', publisher, frames(50))
    outbox.change(lambda pace: pace.set_rate(None, time.monotonic()))
    publisher.wait_for(49)


def test_stop_before_the_beginning(make) -> None:
    make().stop()


def test_an_operator_with_a_slower_link_gets_a_part(make) -> None:
    asked, places, told, publisher = [], [], [], Publisher()

    def route(stream, count, size, now, start=0, total=1, waiting=0.0, whole=False) -> Any:
        if whole:
            return STRAIGHT
        asked.append((stream, count, size))
        places.append((start, total))
        return Route({'/slow': count // 2})
    outbox = make(PacketScheduler(1e6, burst=600), lambda *what: told.append(what), route=route)
    outbox.start()
    outbox.put('scan', publisher, frames(20))
    outbox.publish('gas', publisher, *frames(1))    # small messages go to everybody
    publisher.wait_for(19)
    outbox.stop()
    told = [what for what in told if what[0] == 'scan']
    assert asked == [(stream, count, size) for stream, _, count, size, _, _ in told]
    assert sum(what[2] for what in told) == 20
    assert places == [(sum(count for _, count, _ in asked[:i]), 20) for i in range(len(asked))]
    limits = [given for given in publisher.limits if given is not None]
    assert limits == [what[5].limits for what in told] == [{'/slow': count // 2} for _, count, _ in asked]


def test_what_is_sent_besides_is_charged(make) -> None:
    scheduler, besides = PacketScheduler(1e3, 1000), []
    outbox = make(scheduler, overhead=16, besides=besides.append)
    before = time.monotonic()
    outbox.charge(2, 200)
    passed = time.monotonic() - before
    assert besides == [outbox.protected] == [200 + 2 * (28 + 16)]
    outbox.change(lambda used: used.put('stream', ('stream', None, ()), [(1, 1000)]))
    waits = []
    outbox.change(lambda used: waits.append(used.wait(before)))
    assert 0.288 - 1e-6 <= waits[0] <= 0.288 + passed + 1e-6


def test_the_first_and_the_last_datagram_of_a_message_are_traced(make, tmp_path, monkeypatch) -> None:
    trace, publisher = Trace(str(tmp_path / 'marks')), Publisher()
    monkeypatch.setattr('smokebot_udp.nodes.outbox.TRACE', trace)
    outbox = make(PacketScheduler(1e6, burst=300))
    outbox.start()
    outbox.put('scan/layers', publisher, frames(20, 3), stamp=77)
    publisher.wait_for(22)
    outbox.put('scan', publisher, frames(24))       # not traced
    publisher.wait_for(23)
    outbox.stop()
    first, last = read_marks((tmp_path / 'marks').read_text().splitlines(True))
    assert first[:3] == ('scan', 77, 'first sent') and last[:3] == ('scan', 77, 'last sent')
    assert last.time > first.time


def test_a_scheduler_that_fails_does_not_end_the_outbox(make, monkeypatch: Any) -> None:
    publisher, errors, take = Publisher(), [], PacketScheduler.take

    def fail_first(scheduler: PacketScheduler, now: float) -> Any:
        if len(errors) < 2:
            raise ValueError('broken')
        return take(scheduler, now)
    monkeypatch.setattr(PacketScheduler, 'take', fail_first)
    outbox = make(on_error=lambda stream, error: errors.append((time.monotonic(), str(error))))
    outbox.start()
    outbox.put('a', publisher, frames(3))
    publisher.wait_for(2)
    (first, text), (second, _) = errors
    assert text == 'broken' and second - first > 0.9 * RETRY_PERIOD
