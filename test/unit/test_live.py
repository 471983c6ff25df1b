# SPDX-License-Identifier: BSD-3-Clause
"""dynamic_reconfigure's server of live settings, without a master; the ways together run in integration/focus.test."""
import contextlib
import copy
import http.client
import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Mapping, Sequence

import pytest
from dynamic_reconfigure.client import Client
from dynamic_reconfigure.encoding import decode_config, decode_description, encode_config, encode_description
from polling import WAIT

from smokebot_udp.mission.parameters import Parameter, live
from smokebot_udp.mission.settings import SettingsStore
from smokebot_udp.nodes import live as module
from smokebot_udp.nodes import parameter_watch
from smokebot_udp.nodes.live import LiveSettings, publish_all
from smokebot_udp.nodes.live_server import config_type, serve
from smokebot_udp.nodes.parameter_watch import ParameterWatch
from smokebot_udp.streams import TYPES, tables
from smokebot_udp.udpros import master

TABLE = {'rate': Parameter(10.0, 'Hz', 'how often', above=0.0, most=1000.0, live=True),
         'count': Parameter(3, '', 'how many', least=1, live=True),
         'enabled': Parameter(True, '', 'whether', live=True),
         'fill': Parameter('nearest', '', 'how', choices=('nearest', 'unknown'), live=True),
         'topic': Parameter('x', '', 'where')}
START = {'rate': 10.0, 'count': 3, 'enabled': True, 'fill': 'nearest', 'min_bitrate': 0.0}


def test_only_what_may_change_is_live() -> None:
    assert list(live(TABLE)) == ['rate', 'count', 'enabled', 'fill']


def test_dynamic_reconfigure_understands_the_description() -> None:
    described = decode_description(encode_description(config_type('stream', live(TABLE))))
    by_name = {parameter['name']: parameter for parameter in described['parameters']}
    assert by_name['rate']['type'] == 'double' and by_name['rate']['description'] == 'how often [Hz]'
    assert (by_name['rate']['min'], by_name['rate']['max'], by_name['rate']['default']) == (1e-6, 1000.0, 10.0)
    assert (by_name['count']['type'], by_name['count']['min']) == ('int', 1)
    assert by_name['enabled']['type'] == 'bool'
    choices = eval(by_name['fill']['edit_method'])['enum']     # as rqt_reconfigure reads it
    assert [choice['value'] for choice in choices] == ['nearest', 'unknown']


class Node:
    """Stands in for rospy and the master: a node with one stream's live settings, and what clients see of it."""

    def __init__(self, monkeypatch: Any) -> None:
        self.parameters: Dict[str, Any] = {}
        self.topics: Dict[str, Any] = {}        # the last message on each
        self.services: Dict[str, Any] = {}
        self.problems: List[str] = []
        for name, value in (
                ('get_name', lambda: '/robot'), ('resolve_name', lambda name: name.replace('~', '/robot/')),
                ('Publisher', lambda name, *_, **__: SimpleNamespace(
                    publish=lambda message: self.topics.update({name.replace('~', '/robot/'): message}))),
                ('Service', lambda name, _, serve: self.services.update({name.replace('~', '/robot/'): serve})),
                ('Subscriber', lambda name, _, callback: callback(self.topics[name])),
                ('wait_for_service', lambda *_: None),
                ('ServiceProxy', lambda name, _: lambda config: SimpleNamespace(
                    config=self.services[name](SimpleNamespace(config=config)))),
                ('get_param', lambda *_: {'thermal': {key.split('/')[-1]: value
                                                      for key, value in self.parameters.items()}})):
            monkeypatch.setattr('rospy.' + name, value)
        monkeypatch.setattr(module, 'write_parameters', self.write)
        table = {**live(TABLE), 'min_bitrate': Parameter(0.0, 'kbit/s', 'at least', least=0.0, live=True)}
        self.store = SettingsStore(table, START)
        self.live = LiveSettings('thermal', self.store, self.problems.append)
        publish_all([self.live])
        serve(self.live)

    def write(self, values: Mapping[str, Any]) -> None:
        """As write_parameters of udpros/master.py."""
        self.parameters.update(values)

    def set(self, **values: Any) -> Dict[str, Any]:
        """What `rosservice call` of set_parameters answers."""
        answer = self.services['/robot/thermal/set_parameters'](SimpleNamespace(config=encode_config(values)))
        return {name: value for name, value in decode_config(answer).items() if name != 'groups'}

    @property
    def client(self) -> Any:
        """dynamic_reconfigure's own, as dynparam and rqt_reconfigure have it."""
        return Client('/robot/thermal', timeout=1.0)


@pytest.fixture
def node(monkeypatch: Any) -> Node:
    return Node(monkeypatch)


def test_all_sides_show_the_same(node: Node) -> None:
    assert node.set(rate=7.0) == {**START, 'rate': 7.0} == node.store.current.requested
    assert node.parameters == {'/robot/thermal/' + name: value for name, value in {**START, 'rate': 7.0}.items()}
    assert {**START, 'rate': 7.0}.items() <= node.client.get_configuration().items()
    node.store.request({'count': 5})
    node.live.show()
    assert node.parameters['/robot/thermal/count'] == 5 == node.client.get_configuration()['count']


def test_a_client_with_old_values_brings_none_of_them_back(node: Node) -> None:
    """Once a focus switch was reverted when dynamic_reconfigure set another value right after it."""
    node.store.request({'rate': 4.0, 'count': 9})       # a switch; the server does not have it yet
    assert node.set(enabled=False) == {**START, 'rate': 4.0, 'count': 9, 'enabled': False}
    assert node.store.current.requested == {**START, 'rate': 4.0, 'count': 9, 'enabled': False}


def test_what_a_client_names_is_set_even_where_it_has_it_already(node: Node) -> None:
    node.set(rate=7.0)
    node.store.request({'rate': 4.0})
    assert node.set(rate=7.0)['rate'] == 7.0 == node.store.current['rate']


def test_nor_does_a_client_that_sends_all_values(node: Node) -> None:
    """As those of roscpp do, and rqt_reconfigure when it loads a file."""
    seen = {name: value for name, value in node.client.get_configuration().items() if name != 'groups'}
    node.store.request({'rate': 4.0})
    node.set(**{**seen, 'count': 8})
    assert node.store.current.requested == {**START, 'rate': 4.0, 'count': 8}


def test_a_parameter_that_was_just_set_is_not_overwritten(node: Node) -> None:
    node.parameters['/robot/thermal/rate'] = 3      # and the node has not read it yet
    node.store.request({'count': 9})
    node.live.show()
    assert node.store.current.requested == {**START, 'rate': 3.0, 'count': 9}
    assert node.parameters['/robot/thermal/rate'] == 3.0 == node.client.get_configuration()['rate']
    node.parameters['/robot/thermal/rate'] = 2
    assert node.set(enabled=False)['rate'] == 2.0
    node.parameters['/robot/thermal/rate'] = 1
    assert node.set(rate=5.0)['rate'] == 5.0 == node.parameters['/robot/thermal/rate']


def test_one_value_by_dynamic_reconfigure_leaves_all_grants(node: Node) -> None:
    node.store.grant({'rate': 2.0})
    node.set(enabled=False)
    assert node.store.current.granted == {'rate': 2.0} and node.store.current['rate'] == 2.0


def test_values_are_clamped_or_refused(node: Node) -> None:
    assert node.set(rate=5000.0, count=0) == {**START, 'rate': 1000.0, 'count': 1}
    assert not node.problems
    assert node.set(fill='guess')['fill'] == 'nearest'
    assert node.problems == ["/robot/thermal: fill is 'guess', must be one of nearest, unknown"]
    assert node.set(colour='red', rate=5.0) == {**START, 'rate': 5.0, 'count': 1}
    assert node.problems[1:] == ['/robot/thermal: colour: no such setting']


def test_a_slider_at_its_minimum_is_accepted(node: Node) -> None:
    """Also where a limit is `above 0`: rqt sends what the description has as the minimum."""
    assert node.set(rate=config_type('stream', TABLE).min['rate'])['rate'] == 1e-6
    assert node.set(rate=-1.0)['rate'] == 1e-6 and not node.problems


@pytest.mark.parametrize('kind', TYPES)
def test_the_limits_that_dialogs_offer_are_allowed(kind) -> None:
    for table in tables(kind):
        offered = config_type(kind, live(table))
        for name, parameter in live(table).items():
            for limit in (offered.min[name], offered.max[name]):
                if parameter.kind in (int, float) and abs(limit) < float('inf'):
                    assert parameter.check(limit) == limit


@pytest.mark.parametrize('background', [False, True])
def test_settings_begin_later_where_the_master_is_away_at_the_start(
        node: Node, monkeypatch: Any, background: bool) -> None:
    failures: List[Exception] = [ConnectionRefusedError(111, 'refused'), http.client.IncompleteRead(b'')]
    subscribed, logged = threading.Event(), []

    def write(values: Mapping[str, Any]) -> None:
        if failures:
            raise failures.pop(0)
    monkeypatch.setattr(module, 'write_parameters', write)
    for name, value in (('is_shutdown', lambda: False),
                        ('get_param_cached', lambda _: subscribed.set()),
                        ('logerr', lambda text, *values: logged.append(text % values))):
        monkeypatch.setattr('rospy.' + name, value)
    monkeypatch.setattr(parameter_watch.udpros, 'registered_together', contextlib.nullcontext)
    monkeypatch.setattr(parameter_watch, 'RETRY_PERIOD', 0.01)
    served = threading.Event()
    part = LiveSettings('map', SettingsStore(live(TABLE), {**START, 'topic': 'x'}), node.problems.append)
    monkeypatch.setattr(parameter_watch, 'serve', lambda _: served.set())
    watch = ParameterWatch([part], background)
    assert served.wait(WAIT) and subscribed.is_set() and not failures
    watch.close()
    assert logged == ['settings cannot be changed until the master answers: [Errno 111] refused',
                      'settings cannot be changed until the master answers: IncompleteRead(0 bytes read)']


def test_a_value_that_is_set_while_the_settings_begin_is_read(node: Node, monkeypatch: Any) -> None:
    """By a master that was away when they began first: dynamic_reconfigure's servers are there already."""
    there: Dict[str, Any] = {}

    def subscribe(_: str) -> None:
        there['map']['rate'] = 3.0      # before: the master notifies of later changes only
    def write(values: Mapping[str, Any]) -> None:
        there['map'] = {name.split('/')[-1]: value for name, value in values.items()}
    monkeypatch.setattr(module, 'write_parameters', write)
    for name, value in (('get_param', lambda *_: there), ('get_param_cached', subscribe)):
        monkeypatch.setattr('rospy.' + name, value)
    monkeypatch.setattr(parameter_watch.udpros, 'registered_together', contextlib.nullcontext)
    store, changed = SettingsStore(live(TABLE), {**START, 'topic': 'x'}), threading.Event()
    part = LiveSettings('map', store, node.problems.append)
    monkeypatch.setattr(parameter_watch, 'serve', lambda _: None)
    store.subscribe(lambda settings, changes: changed.set())
    watch = ParameterWatch([part], background=False)
    assert changed.wait(WAIT) and store.current['rate'] == 3.0
    watch.close()


def test_another_nodes_settings_are_shown_in_its_namespace(node: Node, monkeypatch: Any) -> None:
    """As the robot's at an operator's master: what is there is of an earlier time, and not requested."""
    node.parameters = {'/desk/robot/map/rate': 77.0}
    monkeypatch.setattr('rospy.get_param', lambda name, _: {'map': {
        key[len(name + '/map/'):]: value for key, value in node.parameters.items()}})
    for name in ('get_param_cached', 'logerr'):
        monkeypatch.setattr('rospy.' + name, lambda *_: None)
    monkeypatch.setattr(parameter_watch.udpros, 'registered_together', contextlib.nullcontext)
    kept: List[str] = []
    monkeypatch.setattr(parameter_watch, 'keep_parameters', kept.append)
    store, requests = SettingsStore(live(TABLE), {**START, 'topic': 'x'}), []
    part = LiveSettings('map', store, node.problems.append, lambda changes: requests.extend(changes.items()),
                        '/desk/robot')
    served = threading.Event()
    monkeypatch.setattr(parameter_watch, 'serve', lambda _: served.set())
    watch = ParameterWatch([], background=True, node='/desk/robot')
    watch.add(part)
    assert served.wait(WAIT)
    watch.close()
    assert node.parameters == {'/desk/robot/map/' + name: START[name] for name in live(TABLE)}
    assert kept == ['/desk/robot'] and not requests
    part.read({'map': {**part.values, 'rate': 5.0}})
    assert requests == [('rate', 5.0)]


class Master:
    """Stands in for a parameter server, with rospy's own calls and those of this package."""

    def __init__(self, monkeypatch: Any, values: Dict[str, Any]) -> None:
        self.values = values
        self.after_read: Callable[[], None] = lambda: None
        """Called after the values were read, as if another thread came first."""
        self.calls = 0
        for name, value in (('get_name', lambda: '/robot'), ('get_caller_id', lambda: '/robot'),
                            ('get_param', self.read), ('set_param', self.set), ('get_param_cached', lambda _: None),
                            ('logwarn', lambda *_: None)):
            monkeypatch.setattr('rospy.' + name, value)
        monkeypatch.setattr(master.rpc, 'call_all', self.call_all)
        monkeypatch.setattr(master.rpc, 'call', lambda _, method, *args: self.call(method, ('', *args)))
        monkeypatch.setattr(parameter_watch.udpros, 'registered_together', contextlib.nullcontext)
        monkeypatch.setattr(parameter_watch, 'serve', lambda _: None)

    def read(self, *_: Any) -> Any:
        found = copy.deepcopy(self.values['robot'])
        self.after_read()
        return found

    def set(self, name: str, value: Any) -> None:
        """As rosmaster does: a namespace is replaced as a whole."""
        *path, last = name.strip('/').split('/')
        values = self.values
        for part in path:
            values = values.setdefault(part, {})
        values[last] = copy.deepcopy(value)

    def call_all(self, _: str, calls: Sequence[Any], timeout: float) -> List[Any]:
        self.calls += 1
        return [self.call(call['methodName'], call['params']) for call in calls]

    def call(self, method: str, params: Sequence[Any]) -> Any:
        _, *arguments = params
        if method == 'subscribeParam':
            return self.read()
        if method == 'setParam':
            self.set(*arguments)
        return None


def test_what_others_set_while_the_settings_begin_stays(monkeypatch: Any) -> None:
    """As the emergency stop's ~estop_by, and thresholds; the settings themselves are written in one call."""
    server = Master(monkeypatch, {'robot': {'thermal': {'min_bitrate': 50.0, 'warn_loss': 0.2}, 'streams_file': 'x'}})

    def others() -> None:
        server.after_read = lambda: None
        server.set('/robot/estop_by', '/desk')
        server.set('/robot/thermal/warn_age', 2.0)
    server.after_read = others
    table = {**live(TABLE), 'min_bitrate': Parameter(0.0, 'kbit/s', 'at least', least=0.0, live=True)}
    watch = ParameterWatch([LiveSettings(name, SettingsStore(table, START), lambda _: None)
                            for name in ('thermal', 'map')], background=False)
    watch.close()
    assert server.values['robot'] == {
        'thermal': {**START, 'min_bitrate': 50.0, 'warn_loss': 0.2, 'warn_age': 2.0}, 'map': START,
        'streams_file': 'x', 'estop_by': '/desk'}
    assert server.calls == 1


def test_a_new_master_gets_what_it_lacks_and_nothing_else(monkeypatch: Any) -> None:
    server = Master(monkeypatch, {'robot': {'thermal': {'rate': 2.0}, 'estop_by': '/desk'}})
    cache = SimpleNamespace(get=lambda _: {'thermal': {'rate': 1.0, 'count': 3}, 'map': {'rate': 4.0}, 'gone': {},
                                           'estop_by': ''}, update=lambda *_: None)
    monkeypatch.setattr(master, 'get_param_server_cache', lambda: cache)
    server.after_read = lambda: server.set('/robot/focus', 'slow')
    master.register_together(SimpleNamespace(uri='http://localhost:1'), [master.Registration('/robot', '', 'param')])
    assert server.values['robot'] == {'thermal': {'rate': 2.0, 'count': 3}, 'map': {'rate': 4.0}, 'focus': 'slow',
                                      'estop_by': '/desk'}
