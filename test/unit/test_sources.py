# SPDX-License-Identifier: BSD-3-Clause
"""Why nothing comes from a source, and how often the master is asked."""
import threading
from types import SimpleNamespace
from typing import Any, Dict, List, Optional, Tuple

import pytest
from polling import WAIT, wait_for

from smokebot_udp.monitoring.sources import (
    ACTION,
    FIRST_PERIOD,
    GRACE,
    PERIOD,
    SERVICE,
    TOPIC,
    Graph,
    Source,
    SourceWatch,
    graph_of,
    problem_of,
)
from smokebot_udp.monitoring.stats import PAUSED, StreamStats
from smokebot_udp.monitoring.status import ERROR, ROBOT
from smokebot_udp.nodes import diagnostics, stream_problems
from smokebot_udp.nodes.stream_problems import MAX_TEXT, StreamProblems
from smokebot_udp.udpros import rpc

IMAGES = 'sensor_msgs/Image or sensor_msgs/CompressedImage'
GRAPH = Graph(
    {'/front/image_raw/compressed': ['/driver'], '/front/image_raw': ['/driver'], '/scan': ['/sick'], '/fix': ['/gps'],
     '/operator/front/image_raw': ['/operator_receiver'], '/dock/status': ['/docker'], '/dock/result': ['/docker'],
     '/any': ['/talker'], '/gone': []},
    {'/front/image_raw/compressed': 'sensor_msgs/CompressedImage', '/front/image_raw': 'sensor_msgs/Image',
     '/scan': 'sensor_msgs/LaserScan', '/fix': 'std_msgs/String', '/operator/front/image_raw': 'sensor_msgs/Image',
     '/dock/result': 'move_base_msgs/MoveBaseActionResult', '/any': '*'}, ['/lamp', '/driver/set_logger_level'])


@pytest.mark.parametrize('source, problem', [
    (Source(TOPIC, '/front/image_raw/compresed', IMAGES),
     'nobody publishes /front/image_raw/compresed; similar: /front/image_raw/compressed, /front/image_raw'),
    (Source(TOPIC, '/flir/thermal', IMAGES),
     'nobody publishes /flir/thermal; of its type: /front/image_raw, /front/image_raw/compressed'),
    (Source(TOPIC, '/scann', 'sensor_msgs/PointCloud2'), 'nobody publishes /scann; similar: /scan'),
    (Source(TOPIC, '/imu', 'sensor_msgs/Imu'), 'nobody publishes /imu'),
    (Source(TOPIC, '/gone', 'sensor_msgs/Imu'), 'nobody publishes /gone'),
    (Source(TOPIC, '/fix', 'sensor_msgs/NavSatFix'), '/fix is published as std_msgs/String, must be '
     'sensor_msgs/NavSatFix'),
    (Source(TOPIC, '/scan', 'sensor_msgs/LaserScan'), '/sick publishes /scan, but nothing comes'),
    (Source(TOPIC, '/any', 'sensor_msgs/Imu'), '/talker publishes /any, but nothing comes'),
    (Source(SERVICE, '/lamp'), None), (Source(SERVICE, '/lmap'), 'the robot has no service /lmap; similar: /lamp'),
    (Source(ACTION, '/dock', 'move_base_msgs/MoveBaseActionResult'), None),
    (Source(ACTION, '/dok', 'move_base_msgs/MoveBaseActionResult'), 'the robot has no action server /dok; similar: '
     '/dock'),
    (Source(ACTION, '/dock', 'actionlib/TestActionResult'), '/dock/result is published as '
     'move_base_msgs/MoveBaseActionResult, must be actionlib/TestActionResult')])
def test_why_nothing_comes(source: Source, problem: Optional[str]) -> None:
    assert problem_of(source, GRAPH) == problem


def test_a_topic_that_may_be_silent() -> None:
    assert problem_of(Source(TOPIC, '/scan', 'sensor_msgs/LaserScan'), GRAPH, silent=False) is None
    assert problem_of(Source(TOPIC, '/scans', 'sensor_msgs/LaserScan'), GRAPH, silent=False) == (
        'nobody publishes /scans; similar: /scan')


def test_the_masters_answers() -> None:
    assert graph_of([[['/scan', ['/sick']]], [['/x', ['/y']]], [['/lamp', ['/z']]]], [('/scan', 'a/B')]) == Graph(
        {'/scan': ['/sick']}, {'/scan': 'a/B'}, ['/lamp'], {'/x': ['/y']})


class Asked:
    """A watch whose master answers at once."""

    def __init__(self) -> None:
        self.times: List[float] = []
        self.now = 0.0
        self.graph: Optional[Graph] = GRAPH
        self.watch = SourceWatch(self._ask, 0.0)

    def _ask(self) -> None:
        self.times.append(self.now)
        self.watch.answer(self.graph)

    def look(self, source: Source, now: float) -> Optional[str]:
        self.now = now
        return self.watch.problem(source, now)


SCAN = Source(TOPIC, '/scan', 'sensor_msgs/LaserScan')
LOST = Source(TOPIC, '/lost', 'sensor_msgs/Imu')
LAMP = Source(SERVICE, '/lamp')


def test_the_start_is_left_alone_and_then_the_reason_is_known_at_once() -> None:
    asked = Asked()
    found = [asked.look(LOST, second) for second in range(int(GRACE) + 1)]
    assert found == [None] * int(GRACE) + ['nobody publishes /lost'] and asked.times == [GRACE]


def test_a_source_that_stops_is_asked_for_soon_and_never_judged_by_an_older_answer() -> None:
    asked = Asked()
    for second in range(100):
        assert asked.look(LAMP, second) is None
    assert 3 <= len(asked.times) <= 6       # less and less often while all is well
    before = asked.times[-1]
    asked.graph = GRAPH._replace(publishers={})
    later = max(100.0, before + FIRST_PERIOD)
    assert asked.look(SCAN, later) == 'nobody publishes /scan' and asked.times[-1] == later
    assert asked.look(LOST, later + 0.1) is None        # newly silent, and the master was asked just now
    assert asked.look(LOST, later + FIRST_PERIOD) == 'nobody publishes /lost'


def test_while_there_is_a_problem_it_is_looked_after() -> None:
    asked = Asked()
    for tick in range(200):
        asked.look(LOST, GRACE + 0.5 * tick)
    assert {round(later - earlier, 3) for earlier, later in zip(asked.times, asked.times[1:])} == {PERIOD}
    asked.graph = GRAPH._replace(publishers={'/lost': ['/imu']}, types={})
    assert asked.look(LOST, 200.0) == '/imu publishes /lost, but nothing comes'


def test_a_master_that_does_not_answer_is_no_problem_of_sources() -> None:
    asked = Asked()
    asked.graph = None
    assert not any(asked.look(LOST, second) for second in range(20)) and asked.times


# the problems of a node

def test_problems_are_noted_with_one_line_each(monkeypatch: Any) -> None:
    lines: List[str] = []
    monkeypatch.setattr(stream_problems, 'logwarn', lambda subject, text: lines.append(subject + ': ' + text) or True)
    monkeypatch.setattr(stream_problems.rospy, 'loginfo', lambda text, *args: lines.append(text % args))
    problems = StreamProblems({'bad': 'its rate is wrong'})
    changes: List[Dict[str, str]] = []
    problems.subscribe(lambda: changes.append(problems.current))
    for source, other in ((None, None), ('nobody publishes /a', None), ('nobody publishes /a', 'too slow'),
                          (None, '2 calls hang'), (None, '3 calls hang'), (None, None)):
        problems.note('front', source, other)
    assert lines == ["stream 'front': nobody publishes /a", "stream 'front': its source is there now"]
    assert [change.get('front') for change in changes] == ['nobody publishes /a', '2 calls hang', None]
    assert problems.current == {'bad': 'its rate is wrong'}
    problems.note('rear', 'x' * 1000)
    assert len(problems.current['rear']) == MAX_TEXT


class Master:
    """Answers once it may, as over a link that is cut."""

    def __init__(self, monkeypatch: Any, **types: str) -> None:
        self.types = [('/' + topic, type_) for topic, type_ in types.items()]
        self.asked, self.may_answer, self.away = 0, threading.Event(), False
        monkeypatch.setattr(rpc, 'call', self.call)

    def call(self, uri: str, method: str, **_: Any) -> List[Any]:
        self.asked += 1
        assert self.may_answer.wait(WAIT)
        if self.away:
            raise rpc.Unreachable('no answer')
        return self.types if method == 'getTopicTypes' else [[(topic, ['/driver']) for topic, _ in self.types], [], []]


def test_the_diagnostics_of_a_silent_stream_give_the_reason_and_do_not_wait_for_the_master(monkeypatch: Any) -> None:
    master = Master(monkeypatch, fix='std_msgs/String', odom='std_msgs/String')
    monkeypatch.setattr(diagnostics, 'Diagnostics', lambda *arguments: arguments)
    start = 100.0
    monkeypatch.setattr(diagnostics, 'time', SimpleNamespace(monotonic=lambda: start))
    count = [0]

    def stream(name: str, messages: Any, problem: Optional[str] = None) -> Any:
        return SimpleNamespace(name=name, source=Source(TOPIC, '/' + name, 'sensor_msgs/NavSatFix'), topic='/' + name,
                               stats=lambda: StreamStats(messages(), 0, rate=10.0, problem=problem))
    streams: Dict[str, Any] = {'fix': stream('fix', lambda: 0), 'odom': stream('odom', lambda: count[0], PAUSED)}
    parameters = SimpleNamespace(values={}, report=None, refused={})
    way_back = SimpleNamespace(streams={}, statuses=lambda now: [])
    noted = StreamProblems({})
    made: Tuple[Any, Any, Any] = diagnostics.robot_diagnostics(  # type: ignore[assignment]
        streams, way_back, None, parameters, None, SimpleNamespace(stats=lambda now: None),  # type: ignore[arg-type]
        noted)
    side, (fix, odom, _), watch = made
    assert side == ROBOT
    for second in range(5):
        count[0] += 10
        odom(start + second)
        assert not master.asked
    silent = 'no subscriber, its source is silent for 5 s'
    fix(start)
    status = fix(start + 5.0)[0]
    assert status.level == ERROR and status.message == silent
    wait_for(lambda: master.asked)
    master.may_answer.set()
    reason = '/fix is published as std_msgs/String, must be sensor_msgs/NavSatFix'
    wait_for(lambda: fix(start + 5.0)[0].message == silent + ', ' + reason)
    assert noted.current == {'fix': reason}
    master.away = True
    fix(start + 5.0 + PERIOD)
    wait_for(lambda: fix(start + 5.0 + PERIOD)[0].message == 'no subscriber, its source is silent for 10 s')
    watch.close()
