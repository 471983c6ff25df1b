# SPDX-License-Identifier: BSD-3-Clause
"""The robot's receiver of reports of what is held, without its topic."""
from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy
from stub_transport import StubTransport

from smokebot_udp.msg import Held
from smokebot_udp.nodes.held_reports import HeldReports
from smokebot_udp.streams.held import TOPIC, Holding


class Stream:
    def __init__(self) -> None:
        self.reports: List[Any] = []

    def held(self, operator: str, holding: Holding) -> bool:
        self.reports.append((operator, holding))
        return operator == '/desk'


@pytest.fixture
def made(monkeypatch: Any) -> Any:
    """HeldReports with a stream `map`; `receive` takes a report from a node."""
    subscribed: List[Any] = []

    def subscriber(topic: str, message_class: Any, callback: Any, **options: Any) -> Any:
        subscribed.append((topic, message_class, callback))
        return SimpleNamespace(unregister=lambda: subscribed.clear())
    monkeypatch.setattr(rospy, 'logwarn', lambda *_: None)
    stream = Stream()
    reports: Any = HeldReports({'map': stream}, StubTransport(subscriber=subscriber))
    (topic, message_class, callback), = subscribed
    assert (topic, message_class) == (TOPIC, Held)

    def receive(sender: str = '/desk', **fields: Any) -> None:
        message = Held(**{'stream': 'map', 'session': 7, 'first': [3], 'count': [2], **fields})
        message._connection_header = {'callerid': sender}
        callback(message)
    yield SimpleNamespace(reports=reports, stream=stream, receive=receive)
    reports.close()
    assert not subscribed


def test_a_report_reaches_its_stream(made: Any) -> None:
    made.receive()
    assert made.stream.reports == [('/desk', Holding(7, ((3, 2),)))] and not made.reports.dropped


def test_operators_of_one_name_report_by_the_name_that_they_know(made: Any) -> None:
    made.receive('/desk #2')
    assert made.stream.reports == [('/desk #2', Holding(7, ((3, 2),)))]


@pytest.mark.parametrize('reason, fields', [
    ('unknown stream', {'stream': 'lidar'}), ('impossible', {'count': [2, 2]}), ('impossible', {'count': [0]}),
    ('impossible', {'first': [5, 3], 'count': [1, 1]})])
def test_what_is_refused_is_counted_by_reason(made: Any, reason: str, fields: Any) -> None:
    made.receive(**fields)
    assert made.reports.dropped == {reason: 1} and not made.stream.reports


def test_who_receives_nothing_reports_nothing(made: Any) -> None:
    made.receive('/stranger')
    assert made.reports.dropped == {'unknown operator': 1}
