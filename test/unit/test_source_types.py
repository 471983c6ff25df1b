# SPDX-License-Identifier: BSD-3-Clause
import threading
from types import SimpleNamespace
from typing import Any, Dict, List, Tuple

from polling import WAIT, wait_for

from smokebot_udp.monitoring.source_types import PERIOD, SourceTypes
from smokebot_udp.monitoring.stats import StreamStats
from smokebot_udp.monitoring.status import ERROR
from smokebot_udp.nodes import diagnostics
from smokebot_udp.udpros import rpc


def test_a_source_of_another_type_is_named_with_both_types() -> None:
    types = SourceTypes(lambda: None)
    types.types = {'/fix': 'std_msgs/String', '/scan': 'sensor_msgs/LaserScan', '/any': '*'}
    assert types.problem('/fix', 'sensor_msgs/NavSatFix', 0.0) == (
        '/fix is published as std_msgs/String, must be sensor_msgs/NavSatFix')
    assert types.problem('/scan', 'sensor_msgs/LaserScan', 0.0) is None
    assert types.problem('/any', 'sensor_msgs/LaserScan', 0.0) is None
    assert types.problem('/none', 'sensor_msgs/LaserScan', 0.0) is None


def test_they_are_asked_for_seldom() -> None:
    asked: List[float] = []
    types = SourceTypes(lambda: asked.append(0.0))
    for tick in range(10):
        types.problem('/fix', 'sensor_msgs/NavSatFix', PERIOD * tick / 10)
    assert len(asked) == 1
    types.problem('/fix', 'sensor_msgs/NavSatFix', PERIOD)
    assert len(asked) == 2


class Master:
    """Answers once it may, as over a link that is cut."""

    def __init__(self, monkeypatch: Any, **types: str) -> None:
        self.types = [('/' + topic, type_) for topic, type_ in types.items()]
        self.asked, self.may_answer, self.away = 0, threading.Event(), False
        monkeypatch.setattr(rpc, 'call', self.call)

    def call(self, uri: str, method: str, **_: Any) -> List[Tuple[str, str]]:
        assert method == 'getTopicTypes'
        self.asked += 1
        assert self.may_answer.wait(WAIT)
        if self.away:
            raise rpc.Unreachable('no answer')
        return self.types


def test_the_diagnostics_of_a_silent_stream_name_the_published_type_and_do_not_wait_for_the_master(
        monkeypatch: Any) -> None:
    master = Master(monkeypatch, fix='std_msgs/String', odom='std_msgs/String')
    monkeypatch.setattr(diagnostics, 'Diagnostics', lambda *arguments: arguments)
    start = 100.0
    monkeypatch.setattr(diagnostics, 'time', SimpleNamespace(monotonic=lambda: start))
    count = [0]

    def stream(name: str, messages: Any) -> Any:
        return SimpleNamespace(name=name, topic='/' + name, source_type='sensor_msgs/NavSatFix',
                               stats=lambda: StreamStats(messages(), 0, rate=10.0))
    streams: Dict[str, Any] = {'fix': stream('fix', lambda: 0), 'odom': stream('odom', lambda: count[0])}
    parameters = SimpleNamespace(values={}, report=None)
    way_back = SimpleNamespace(streams={}, statuses=lambda now: [])
    (fix, odom, _), types = diagnostics.robot_diagnostics(  # type: ignore[misc,attr-defined]
        streams, way_back, None, parameters, None, SimpleNamespace(stats=lambda now: None))  # type: ignore[arg-type]
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
    wait_for(lambda: types.types)
    assert fix(start + 5.0)[0].message == (
        silent + ', /fix is published as std_msgs/String, must be sensor_msgs/NavSatFix')
    master.away = True
    fix(start + 5.0 + PERIOD)
    wait_for(lambda: not types.types)
    types.close()
