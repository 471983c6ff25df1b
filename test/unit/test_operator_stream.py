# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the operator's side, with topics that stay in this process."""
import queue
import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Dict, Iterator, List, Optional, Sequence

import numpy as np
import pytest
import rospy
from polling import WAIT, wait_for
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header, String
from stub_transport import StubTransport

from smokebot_udp.image_error import ImageError
from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.monitoring.stats import ConnectionStats, Shown, StreamStats
from smokebot_udp.nodes import operator_stream
from smokebot_udp.nodes.operator_stream import CLEAR_PERIOD, CLEARING, OperatorLink, OperatorStream
from smokebot_udp.streams.assembler import Assembled, Assembler
from smokebot_udp.streams.frame_assembler import Frame
from smokebot_udp.streams.held import Holding
from smokebot_udp.streams.parameters import OPERATOR
from smokebot_udp.streams.segments import MAIN_PART

GOOD = np.ones(1, bool)
STAMP = 90 * 10 ** 9
NOW = 100
ERROR = ImageError(2.0)


class FakeAssembler(Assembler[Any, Assembled]):
    """Makes of each record a message, and keeps a record of what is called."""
    MESSAGE, SEGMENTS, COMPILED = String, {MAIN_PART: String, 'layers': String}, frozenset(['layers'])
    REPORT_INTERVAL = 0.25
    PARAMETERS = {**OPERATOR, 'max_wait': Parameter(0.1, 's', '', above=0.0, live=True),
                  'fill': Parameter('nearest', '', '', live=True)}

    def __init__(self, settings: Any, clock: Any) -> None:
        super().__init__(settings, clock)
        self.finished: List[Any] = []
        self.log: queue.Queue[Any] = queue.Queue()

    def configure(self, settings: Any, changed: Any) -> None:
        self.log.put(('configure', dict(changed)))

    def receive(self, records: Any, mask: Any, now: float, part: str = MAIN_PART) -> None:
        self.finished.append(records if part == MAIN_PART else (part, records))

    def deadline(self) -> Optional[float]:
        return 0.0 if self.finished else None

    def poll(self, now: float) -> Optional[Any]:
        return self.finished.pop(0) if self.finished else None

    def assemble(self, finished: Any, settings: Any, still: bool, now: float) -> Optional[Assembled]:
        self.log.put(('assemble', finished, still))
        if finished == 'broken':
            raise ValueError('it is broken')
        if finished == 'warn':
            self.warnings.append('something is odd')
        assembled = Assembled(finished, STAMP, 0.5)
        assembled.error = ERROR
        return None if finished == 'same' else assembled

    def settle(self, finished: Any, assembled: Assembled, settings: Any, now: float) -> None:
        self.log.put(('settle', finished))
        assembled.changed = 0.25

    def holding(self) -> Holding:
        return Holding(3, ((1, 2),))

    def problem(self, settings: Any, now: float) -> Optional[str]:
        return 'slow' if settings['fill'] == 'slow' else None


class VideoAssembler(FakeAssembler):
    SEGMENTS, DECODED, HOLDS_SHOWN = {MAIN_PART: String, 'video': String}, frozenset(['video']), True

    def __init__(self, settings: Any, clock: Any, decoder: Any) -> None:
        super().__init__(settings, clock)


class BrokenDecoder:
    """Cannot load PyAV, which it notices with the first image."""

    def __init__(self, name: str) -> None:
        self.broken, self.dropped = True, {'decoder broken': 1}

    def close(self) -> None:
        pass


class ForwardingAssembler(FakeAssembler):
    FORWARDS, LATCH, STEADY = True, True, False

    def join(self, segment: Any) -> Sequence[Any]:
        return [] if segment == 'part' else [segment]

    def forward(self, message: Any) -> Optional[Assembled]:
        self.warnings += ['odd'] * (message == 'odd')
        return None if message == 'same' else Assembled(message, 0, None)


class StampedForwarder(ForwardingAssembler):
    def forward(self, message: Any) -> Optional[Assembled]:
        return Assembled(message, message * 10 ** 9, None)


class ScanAssembler(ForwardingAssembler):
    MESSAGE = LaserScan


class FakeTopic:
    """Stands in for publishers of rospy and subscribers of a transport."""

    def __init__(self, log: Any, name: str, class_: Any, **options: Any) -> None:
        self.log, self.name, self.options, self.closed = log, name, options, False

    def publish(self, message: Any) -> None:
        self.log.put(('publish', message))

    def connections(self) -> List[Any]:
        return [{'peer': '/robot', 'address': ('10.0.0.1', 5), 'datagrams': 1, 'bytes': 99}]

    def unregister(self) -> None:
        self.closed = True


class Bench:
    """Makes streams without ROS."""

    def __init__(self, monkeypatch: Any) -> None:
        self.topics: Dict[str, FakeTopic] = {}
        self.compared: queue.Queue[Any] = queue.Queue()
        self.logged: queue.Queue[str] = queue.Queue()
        self.held: queue.Queue[Any] = queue.Queue()
        self.streams: List[OperatorStream] = []
        self.log: queue.Queue[Any] = queue.Queue()
        self._class: Any = FakeAssembler
        monkeypatch.setattr(operator_stream, 'assembler_class', lambda kind: self._class)
        monkeypatch.setattr(rospy, 'Publisher', self._topic)
        monkeypatch.setattr(rospy.Time, 'now', lambda: rospy.Time(NOW))
        for level in 'logerr', 'logwarn':
            monkeypatch.setattr(rospy, level, lambda text, *args: self.logged.put(text % args))

    def _topic(self, name: str, class_: Any, **options: Any) -> FakeTopic:
        self.topics[name] = FakeTopic(self.log, name, class_, **options)
        return self.topics[name]

    def start(self, class_: Any = FakeAssembler, name: str = 'thermal', codec: Any = None, frame_prefix: str = '',
              video_decoder: Any = None) -> OperatorStream:
        self._class = class_
        settings = {'type': 'fake', 'operator_topic': '/operator/' + name, 'max_wait': 0.1, 'fill': 'nearest',
                    'robot_topic': '/robots'}
        link = OperatorLink(StubTransport(subscriber=self._topic), is_still=lambda: True, codec=codec,
                            images_compared=self.compared.put, video_decoder=video_decoder, frame_prefix=frame_prefix,
                            arrived=lambda name, *rest: self.log.put(('arrived', name, *rest)),
                            received=lambda *report: self.held.put(report))
        stream = OperatorStream(name, settings, link)
        stream.assembler.log = self.log     # type: ignore[attr-defined]
        stream.start()
        self.streams.append(stream)
        return stream

    def receive(self, records: Any, name: str = 'thermal', part: str = MAIN_PART) -> None:
        self.topics['/smokebot_udp/%s/%s' % (name, part)].options['batch_callback'](records, GOOD)

    def logs(self, count: int) -> List[Any]:
        return [self.log.get(timeout=WAIT) for _ in range(count)]


@pytest.fixture
def bench(monkeypatch: Any) -> Iterator[Bench]:
    made = Bench(monkeypatch)
    yield made
    for stream in made.streams:
        stream.close()


def test_a_message_is_published_and_then_settled(bench: Bench) -> None:
    stream = bench.start()
    assert stream.last_shown is None
    bench.receive('one')
    assert bench.logs(3) == [('assemble', 'one', True), ('publish', 'one'), ('settle', 'one')]
    assert bench.compared.get(timeout=WAIT) == 0.25
    stats = stream.stats()
    assert 0 < stats.busy < WAIT
    assert replace(stats, busy=0.0) == StreamStats(1, 1, shown=[Shown(10.0, 0.5, ERROR)], connections=[
        ConnectionStats('/robot', ('10.0.0.1', 5), 1, 99, name=name) for name in ('thermal', 'thermal/layers')])
    assert stream.stats().shown == [] and stream.last_shown is not None


@pytest.mark.parametrize('class_, name', [(FakeAssembler, 'batch_callback'), (ForwardingAssembler, 'callback')])
def test_frames_are_published_with_the_prefix(bench: Bench, class_: Any, name: str) -> None:
    bench.start(class_, frame_prefix='ugv1/')
    received = Header(frame_id='map')
    bench.topics['/smokebot_udp/thermal/segments'].options[name](*[received, GOOD][:1 + (class_ is FakeAssembler)])
    published = next(entry[1] for entry in iter(bench.log.get, None) if entry[0] == 'publish')
    assert (received.frame_id, published.frame_id) == ('map', 'ugv1/map')


def test_the_age_counts_from_the_arrival_where_the_stamp_does_not_say_it(bench: Bench) -> None:
    stream = bench.start()
    for arrival, age in ((0, NOW - 90.0), (97 * 10 ** 9, 3.0)):
        frame: Any = Frame(SimpleNamespace(stamp=STAMP, arrival=arrival), None, 0.0, 0.0)    # type: ignore[type-var]
        published = stream.published
        bench.receive(frame)
        wait_for(lambda before=published: stream.published > before)
        assert stream.stats().shown[-1].age == age == stream.age(0.0, stream.last_shown or 0.0)


def test_the_age_of_a_relayed_message_of_another_epoch_is_unknown(bench: Bench, monkeypatch: Any) -> None:
    stream = bench.start(StampedForwarder, 'imu')
    for tick, stamp in enumerate((*range(7, 20), *range(113, 120))):
        monkeypatch.setattr(rospy.Time, 'now', lambda at=NOW + tick: rospy.Time(at))
        bench.topics['/smokebot_udp/imu/segments'].options['callback'](stamp)
    ages = [shown.age for shown in stream.stats().shown]
    assert ages[:4] == [93.0] * 4 and ages[4:13] == [None] * 9
    assert ages[13:17] == [None] * 4 and ages[17:] == [0.0] * 3      # its clock was set


def test_messages_come_out_in_order(bench: Bench) -> None:
    bench.start()
    for number in range(20):
        bench.receive(number)
    published = [entry[1] for entry in bench.logs(60) if entry[0] == 'publish']
    assert published == list(range(20))


def test_what_was_published_already_is_only_counted(bench: Bench) -> None:
    stream = bench.start()
    bench.receive('same')
    bench.receive('new')
    assert [entry[0] for entry in bench.logs(4)] == ['assemble', 'assemble', 'publish', 'settle']
    assert (stream.received, stream.published) == (2, 1)


def test_an_error_names_the_stream_and_stops_neither_it_nor_others(bench: Bench) -> None:
    bench.start()
    bench.start(name='camera')
    bench.receive('broken')
    assert bench.logged.get(timeout=WAIT) == "stream 'thermal': a message is not published: it is broken"
    bench.receive('good')
    bench.receive('also good', 'camera')
    published = {entry[1] for entry in bench.logs(7) if entry[0] == 'publish'}
    assert published == {'good', 'also good'}


def test_warnings_are_logged_once(bench: Bench) -> None:
    bench.start()
    bench.receive('warn')
    assert bench.logged.get(timeout=WAIT) == "stream 'thermal': something is odd"
    bench.receive('good')
    bench.logs(6)
    assert bench.logged.empty()


def test_whole_messages_are_published_in_the_transports_thread(bench: Bench) -> None:
    stream = bench.start(ForwardingAssembler)
    forward = bench.topics['/smokebot_udp/thermal/segments'].options['callback']
    for message in 'part', 'one', 'part', 'same', 'odd':
        forward(message)
    assert bench.logs(2) == [('publish', 'one'), ('publish', 'odd')] and bench.log.empty()
    assert bench.logged.get_nowait() == "stream 'thermal': odd"
    stats = stream.stats()
    assert (stats.messages_in, stats.messages_out, stats.shown, stats.steady) == (
        3, 2, [Shown(None, None)] * 2, False)
    assert bench.topics['/operator/thermal'].options['latch'] is True


def test_settings_reach_the_assembler_as_a_true_delta(bench: Bench) -> None:
    stream = bench.start()
    stream.settings.request({'max_wait': 0.3, 'fill': 'nearest'})
    assert bench.logs(1) == [('configure', {'max_wait': 0.3})]
    stream.settings.request({'max_wait': 0.3})
    assert bench.log.empty()
    with pytest.raises(ValueError, match='max_wait is -1'):
        stream.settings.request({'max_wait': -1.0})
    with pytest.raises(ValueError, match='robot_topic: no such setting'):
        stream.settings.request({'robot_topic': '/elsewhere'})
    stream.settings.request({'fill': 'slow'})
    assert stream.stats().problem == 'slow'


def test_closing_joins_the_thread_and_closes_the_topics(bench: Bench) -> None:
    count = threading.active_count()
    stream = bench.start()
    assert threading.active_count() == count + 1
    stream.close()
    assert threading.active_count() == count and all(topic.closed for topic in bench.topics.values())
    bench.receive('late')
    assert bench.log.empty()


def test_all_parts_are_received_from_the_start_and_reported_by_their_names(bench: Bench) -> None:
    bench.start()
    bench.receive('one', part='layers')
    assert bench.logs(2)[1] == ('publish', ('layers', 'one'))
    for part, name in ((MAIN_PART, 'thermal'), ('layers', 'thermal/layers')):
        bench.logs(bench.log.qsize())
        bench.topics['/smokebot_udp/thermal/' + part].options['arrived'](1, 2, 3, 4, 5.0)
        while True:
            entry = bench.logs(1)[0]
            if entry[0] == 'arrived':
                break
        assert entry == ('arrived', name, 1, 2, 3, 4, 5.0)


class FakeCodec:
    problem: Optional[str] = None
    loaded, asked = False, 0

    def ready(self) -> bool:
        self.asked += 1
        self.problem = None if self.loaded else 'it is loaded'
        return self.loaded


def test_a_compiled_part_is_connected_once_the_codec_is_loaded_and_says_so(bench: Bench) -> None:
    """Loading begins with the stream. Until the part is connected the robot sends the other one."""
    codec = FakeCodec()
    streams = [bench.start(name=name, codec=codec) for name in ('thermal', 'other')]
    wanted = bench.topics['/smokebot_udp/thermal/layers'].options['wanted']
    assert 'wanted' not in bench.topics['/smokebot_udp/thermal/segments'].options
    bench.receive('interleaved')
    assert bench.logs(2)[1] == ('publish', 'interleaved') and codec.asked == len(streams)
    for loaded, problem in ((False, 'it is loaded'), (True, None)):
        codec.loaded = loaded
        assert wanted() is loaded
        assert [stream.stats().problem for stream in streams] == [problem, None]
    bench.start(name='third')
    assert bench.topics['/smokebot_udp/third/layers'].options['wanted']()      # without a codec


class WorkingAssembler(FakeAssembler):
    """An assembler for which each record of the part `layers` takes work. After the work the record is held."""

    def __init__(self, settings: Any, clock: Any) -> None:
        super().__init__(settings, clock)
        self.works: List[Any] = []

    def receive(self, records: Any, mask: Any, now: float, part: str = MAIN_PART) -> None:
        (self.finished if part == MAIN_PART else self.works).append(records)

    def deadline(self) -> Optional[float]:
        return 0.0 if self.finished or self.works else None

    def work(self) -> Any:
        if not self.works:
            return None
        record = self.works.pop(0)

        def do() -> None:
            self.log.put(('do', record))
            if record == 'broken':
                raise ValueError('it is broken')
        return SimpleNamespace(do=do, done=lambda: self.log.put(('done', record)))


def test_what_takes_work_is_reported_as_held_when_it_is_done(bench: Bench) -> None:
    bench.start(WorkingAssembler)
    bench.receive('one')
    assert bench.logs(3)[1] == ('publish', 'one') and bench.held.empty()
    bench.receive('two', part='layers')
    name, holding, interval = bench.held.get(timeout=WAIT)
    assert (name, holding(), interval) == ('thermal', Holding(3, ((1, 2),)), 0.25)
    assert bench.logs(2) == [('do', 'two'), ('done', 'two')]


def test_work_is_done_without_the_lock_in_turns_with_messages_and_may_fail(bench: Bench) -> None:
    going, go = threading.Event(), threading.Event()

    class Slow(WorkingAssembler):
        def work(self) -> Any:
            found = super().work()
            if found is not None and not go.is_set():
                first = found.do
                found.do = lambda: (going.set(), go.wait(WAIT), first())
            return found
    bench.start(Slow)
    bench.receive('broken', part='layers')
    assert going.wait(WAIT)
    bench.receive('two', part='layers')     # does not wait
    bench.receive('three')
    go.set()
    assert [entry for entry in bench.logs(7) if entry[0] in ('do', 'done', 'publish')] == [
        ('do', 'broken'), ('done', 'broken'), ('publish', 'three'), ('do', 'two'), ('done', 'two')]
    assert 'it is broken' in bench.logged.get(timeout=WAIT)


def test_what_is_held_once_it_is_shown_is_reported_after_each_message_shown_or_not(bench: Bench) -> None:
    class Shows(FakeAssembler):
        HOLDS_SHOWN = True
    bench.start(Shows)
    for message in ('one', 'same'):
        bench.receive(message)
        assert bench.held.get(timeout=WAIT)[0] == 'thermal'
    assert [entry for entry in bench.logs(3) if entry[0] == 'publish'] == [('publish', 'one')] and bench.held.empty()


def test_a_part_that_nothing_decodes_is_received_no_more(bench: Bench) -> None:
    stream = bench.start(VideoAssembler, video_decoder=BrokenDecoder)
    bench.receive('same', part='video')
    bench.held.get(timeout=WAIT)      # after the image
    assert stream.stats().connections[0].name == 'thermal' and len(stream.stats().connections) == 1
    assert [bench.topics['/smokebot_udp/thermal/' + part].closed for part in (MAIN_PART, 'video')] == [False, True]


def test_a_scan_is_cleared_for_a_while_unless_a_newer_one_was_shown(bench: Bench) -> None:
    stream = bench.start(ScanAssembler)
    callback = bench.topics['/smokebot_udp/thermal/segments'].options['callback']
    callback(LaserScan(ranges=[1.0]))
    first = stream.last_shown
    callback(LaserScan(ranges=[2.0]))
    assert first is not None and stream.last_shown is not None
    stream.clear(first, 9.0)
    for now in (10.0, 12.0, 10.0 + CLEARING, 10.0 + CLEARING + CLEAR_PERIOD / 2, 10.0 + CLEARING + CLEAR_PERIOD, 300.0):
        stream.clear(stream.last_shown, now)
    ranges = [message.ranges for _, message in bench.logs(7)]
    assert ranges[:2] == [[1.0], [2.0]]
    assert all(len(blank) == 1 and np.isnan(blank).all() for blank in ranges[2:])
    assert bench.log.empty()
    callback(LaserScan(ranges=[3.0]))
    stream.clear(stream.last_shown, 301.0)
    assert [bool(np.isnan(message.ranges).all()) for _, message in bench.logs(2)] == [False, True]


def test_what_has_no_blank_message_is_not_cleared(bench: Bench) -> None:
    stream = bench.start()
    bench.receive('one')
    bench.logs(3)
    assert stream.last_shown is not None
    stream.clear(stream.last_shown, 10.0)
    assert bench.log.empty()
