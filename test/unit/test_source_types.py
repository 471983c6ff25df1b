# SPDX-License-Identifier: BSD-3-Clause
from types import SimpleNamespace
from typing import Any, Dict, List, Tuple

from polling import wait_for

from smokebot_udp.monitoring.source_types import PERIOD, SourceTypes
from smokebot_udp.monitoring.stats import StreamStats
from smokebot_udp.monitoring.status import ERROR
from smokebot_udp.nodes import diagnostics

PERIOD_SECONDS = int(PERIOD)


class Master:
    """Counts how often it is asked."""

    def __init__(self, **types: str) -> None:
        self.types, self.asked, self.away = types, 0, False

    def __call__(self) -> List[Tuple[str, str]]:
        self.asked += 1
        if self.away:
            raise OSError('no answer')
        return [('/' + topic, type) for topic, type in self.types.items()]


def test_a_source_of_another_type_is_named_with_both_types() -> None:
    types = SourceTypes(Master(fix='std_msgs/String', scan='sensor_msgs/LaserScan', any='*'))
    assert types.problem('/fix', 'sensor_msgs/NavSatFix', 0.0) == (
        '/fix is published as std_msgs/String, must be sensor_msgs/NavSatFix')
    assert types.problem('/scan', 'sensor_msgs/LaserScan', 0.0) is None
    assert types.problem('/any', 'sensor_msgs/LaserScan', 0.0) is None
    assert types.problem('/none', 'sensor_msgs/LaserScan', 0.0) is None


def test_the_master_is_asked_seldom_and_may_be_away() -> None:
    master = Master(fix='std_msgs/String')
    types = SourceTypes(master)
    for tick in range(10):
        assert types.problem('/fix', 'sensor_msgs/NavSatFix', PERIOD * tick / 10)
    assert master.asked == 1
    master.away = True
    assert types.problem('/fix', 'sensor_msgs/NavSatFix', PERIOD) is None
    assert types.problem('/fix', 'sensor_msgs/NavSatFix', 1.5 * PERIOD) is None and master.asked == 2


def test_while_the_answer_is_awaited_it_is_asked_for_each_time() -> None:
    answers: List[Any] = [None, None, [('/fix', 'std_msgs/String')]]
    types = SourceTypes(lambda: answers.pop(0))
    found = [types.problem('/fix', 'sensor_msgs/NavSatFix', float(second)) for second in range(PERIOD_SECONDS + 2)]
    assert [one is None for one in found] == [True, True] + [False] * PERIOD_SECONDS and not answers


def test_the_diagnostics_of_a_silent_stream_name_the_published_type(monkeypatch: Any) -> None:
    master = Master(fix='std_msgs/String', odom='std_msgs/String')
    monkeypatch.setattr(diagnostics, '_topic_types', master)
    monkeypatch.setattr(diagnostics, 'Diagnostics', lambda sources: sources)
    start = 100.0
    monkeypatch.setattr(diagnostics, 'time', SimpleNamespace(monotonic=lambda: start))
    count = [0]

    def stream(name: str, messages: Any) -> Any:
        return SimpleNamespace(name=name, topic='/' + name, source_type='sensor_msgs/NavSatFix',
                               stats=lambda: StreamStats(messages(), 0, rate=10.0))
    streams: Dict[str, Any] = {'fix': stream('fix', lambda: 0), 'odom': stream('odom', lambda: count[0])}
    parameters = SimpleNamespace(values={}, report=None)
    way_back = SimpleNamespace(streams={}, statuses=lambda now: [])
    fix, odom, _ = diagnostics.robot_diagnostics(streams, way_back, None, parameters, None,   # type: ignore
                                                 SimpleNamespace(stats=lambda now: None))
    for second in range(5):
        count[0] += 10
        odom(start + second)
        assert not master.asked
    fix(start)
    wait_for(lambda: '/fix is published' in fix(start + 5.0)[0].message)
    status = fix(start + 5.0)[0]
    assert status.level == ERROR and status.message == (
        'no subscriber, its source is silent for 5 s, '
        '/fix is published as std_msgs/String, must be sensor_msgs/NavSatFix')
