# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Dict, List

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.mission.mirror import Mirror
from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.mission.settings import SettingsStore

TABLE = {'rate': Parameter(10.0, 'Hz', 'how often', above=0.0, live=True),
         'weight': Parameter(1.0, '', 'a share', least=0.0, live=True),
         'min_bitrate': Parameter(0.0, '', 'at least', least=0.0, live=True),
         'low': Parameter(1, '', 'below high', live=True), 'high': Parameter(5, '', 'above low', live=True)}
START = {'rate': 10.0, 'weight': 1.0, 'min_bitrate': 0.0, 'low': 1, 'high': 5}


def in_order(requested: Any) -> None:
    if requested['low'] >= requested['high']:
        raise ValueError('low is not below high')


class Server:
    """A namespace of a parameter server with its mirror, and what was reported."""

    def __init__(self, **there: Any) -> None:
        self.store = SettingsStore(TABLE, START, in_order)
        self.problems: List[str] = []
        self.mirror = Mirror('/robot/thermal', self.store, self.store.request, self.problems.append, ('warn_loss',))
        self.there: Any = dict(there)
        self.sync()

    def sync(self) -> bool:
        """As a node does when it is notified."""
        news = self.mirror.read(self.there)
        self.write()
        return news

    def write(self) -> None:
        values = self.mirror.to_write()
        if values and not isinstance(self.there, dict):
            self.there = {}
        self.there.update(values)
        self.mirror.written(values)

    def set(self, **values: Any) -> None:
        self.there.update(values)
        assert self.sync()

    @property
    def requested(self) -> Dict[str, Any]:
        return dict(self.store.current.requested)


def test_all_settings_are_written_at_the_start_and_those_found_taken() -> None:
    server = Server(rate=7, weight=-1, warn_loss=0.5)
    assert server.requested == {**START, 'rate': 7.0}
    assert server.there == {**START, 'rate': 7.0, 'warn_loss': 0.5}
    assert server.problems == ['/robot/thermal/weight refused, 1.0 stays: weight is -1, must be a number from 0']
    assert not server.sync()


def test_a_value_that_somebody_sets_is_taken_or_set_back() -> None:
    server = Server()
    server.set(rate=7)
    assert server.requested['rate'] == 7.0 and server.there['rate'] == 7.0 and not server.problems
    server.set(rate='fast', weight=2.0)
    assert server.there == {**START, 'rate': 7.0, 'weight': 2.0}
    assert server.problems == ["/robot/thermal/rate refused, 7.0 stays: rate is 'fast', must be a number above 0 [Hz]"]


def test_values_that_only_fit_together_are_taken_together() -> None:
    server = Server()
    server.set(low=8, high=9)
    assert (server.requested['low'], server.requested['high']) == (8, 9) and not server.problems


def test_values_that_change_otherwise_are_written() -> None:
    server = Server()
    server.store.request({'rate': 3.0})
    assert not server.mirror.read(server.there)
    assert server.mirror.to_write() == {'rate': 3.0}
    server.write()
    assert server.there['rate'] == 3.0 and not server.sync()


def test_what_a_replaced_namespace_leaves_out_is_put_back_and_goes_on_working() -> None:
    """As `rosparam set /robot/thermal '{rate: 7}'` and `rosparam load` do."""
    server = Server(weight=2.0)
    server.there = {'rate': 7}
    assert server.sync()
    assert server.requested == {**START, 'weight': 2.0, 'rate': 7.0} == server.there
    server.set(weight=3.0)
    assert server.requested['weight'] == 3.0
    server.there = {}
    assert server.sync()
    assert server.requested == {**START, 'weight': 3.0, 'rate': 7.0} == server.there
    assert not server.problems


@pytest.mark.parametrize('value', [5, 'fast', [1, 2], True])
def test_a_namespace_that_is_no_namespace_is_set_back(value: Any) -> None:
    server = Server(weight=2.0)
    server.there = value
    assert server.sync()
    assert server.there == {**START, 'weight': 2.0} == server.requested
    assert server.problems == ['/robot/thermal is %r, must be settings with values: it is set back' % (value,)]


def test_a_deleted_value_is_put_back() -> None:
    server = Server(rate=7.0)
    server.there['rate'] = {}       # as rospy's cache has it
    assert server.sync()
    assert server.there == {**START, 'rate': 7.0} and not server.problems


def test_unknown_names_are_reported_once() -> None:
    server = Server()
    server.there = {'rate': 7.0, 'colour': 'red', 'tone': 0.5, 'warn_loss': 0.1}
    server.sync()
    server.set(weight=3.0)
    assert server.problems == [
        '/robot/thermal: colour, tone: no such setting; there are high, low, min_bitrate, rate, weight']
    assert server.requested['rate'] == 7.0
    server.there['size'] = 1
    server.sync()
    assert len(server.problems) == 2 and '/robot/thermal: size: no such setting' in server.problems[1]


@given(st.lists(st.one_of(
    st.dictionaries(st.sampled_from([*TABLE, 'colour']), st.one_of(st.integers(-2, 9), st.just('x'))),
    st.integers(), st.tuples(st.sampled_from(list(TABLE)), st.integers(-2, 9))), max_size=6))
def test_after_any_change_both_have_the_same(steps: List[Any]) -> None:
    server = Server()
    for step in steps:
        if isinstance(step, tuple):
            server.there[step[0]] = step[1]
        else:
            server.there = dict(step) if isinstance(step, dict) else step
        server.sync()
        assert {name: server.there[name] for name in TABLE} == server.requested
        assert all(type(server.there[name]) is TABLE[name].kind for name in TABLE)
        assert not server.sync()


@pytest.mark.parametrize('namespace', ['/robot_sender', '/robot_sender/front'])
def test_a_refused_value_is_named_in_full(namespace: str) -> None:
    problems: List[str] = []
    store = SettingsStore(TABLE, START)
    mirror = Mirror(namespace, store, store.request, problems.append, others=())
    mirror.read({**START, 'rate': -1.0})
    mirror.read({**START, 'colour': 'red'})
    mirror.read('red')
    assert [problem.split(' ')[0] for problem in problems] == [namespace + '/rate', namespace + ':', namespace]
