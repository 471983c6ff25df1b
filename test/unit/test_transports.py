# SPDX-License-Identifier: BSD-3-Clause
"""The choice of the transport, and what is wrong with its parameters."""
import os
import pathlib
import socket
import threading
from typing import Any, Callable, Dict, List

import pytest
from polling import WAIT, wait_for

from smokebot_udp.link.keys import make_key, read_key
from smokebot_udp.nodes import parameters as tables
from smokebot_udp.nodes import transports
from smokebot_udp.nodes.common import Parameters
from smokebot_udp.nodes.transports import (
    addresses_in,
    foreign_master,
    host_and_port,
    operator_transport,
    robot_transport,
)


class Log:
    """What a node logs, and an event for each error."""

    def __init__(self, monkeypatch: Any) -> None:
        self.errors: List[str] = []
        self.warnings: List[str] = []
        self.infos: List[str] = []
        self.new_error = threading.Event()
        monkeypatch.setattr('rospy.logerr', self._error)
        monkeypatch.setattr('rospy.logwarn', lambda text, *values: self.warnings.append(text % values))
        monkeypatch.setattr('rospy.loginfo', lambda text, *values: self.infos.append(text % values))
        monkeypatch.setattr('rospy.is_shutdown', lambda: False)
        monkeypatch.setattr(transports, 'RETRY_PERIOD', 0.01)

    def _error(self, text: str, *values: Any) -> None:
        self.errors.append(text % values)
        self.new_error.set()


@pytest.fixture
def log(monkeypatch: Any) -> Log:
    return Log(monkeypatch)


@pytest.fixture(autouse=True)
def home(monkeypatch: Any, tmp_path: pathlib.Path) -> pathlib.Path:
    """A home folder without a key."""
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    return tmp_path / 'home'


def parameters(monkeypatch: Any, table: Any, values: Dict[str, Any], problems: List[str]) -> Parameters:
    monkeypatch.setattr('rospy.get_param', lambda *_: values)
    return Parameters(table, problems.append)


def waits(log: Log, monkeypatch: Any, make: Callable[[], Any]) -> List[str]:
    """What a node logs that waits until it is shut down."""
    shut_down = threading.Event()
    monkeypatch.setattr('rospy.is_shutdown', shut_down.is_set)
    ended: List[BaseException] = []

    def run() -> None:
        try:
            make()
        except SystemExit as error:
            ended.append(error)
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert log.new_error.wait(WAIT)
    shut_down.set()
    thread.join(WAIT)
    assert len(ended) == 1
    return log.errors


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('', 0))
        return int(probe.getsockname()[1])


def test_a_robot_may_have_several_addresses() -> None:
    assert addresses_in('10.0.0.7:17001') == [('10.0.0.7', 17001)]
    assert addresses_in('10.0.0.7:17001, lte.local:1') == [('10.0.0.7', 17001), ('lte.local', 1)]
    assert addresses_in('a%wlan0:1,a%wwan0:1') == [('a%wlan0', 1), ('a%wwan0', 1)]
    for text, reason in (('a:1,a:1', "robot is 'a:1,a:1': a:1 stands twice"),
                         ('a:1,', "robot is '', must be HOST:PORT, such as 10.0.0.7:17001 or 10.0.0.7%wwan0:17001"),
                         ('a:1,b:1,c:1,d:1,e:1', "robot is 'a:1,b:1,c:1,d:1,e:1': it has 5 addresses, at most 4 are "
                                                 'used')):
        with pytest.raises(ValueError) as error:
            addresses_in(text)
        assert str(error.value) == reason


def test_an_address_has_a_host_and_a_port() -> None:
    assert host_and_port('10.0.0.7:17001') == ('10.0.0.7', 17001)
    assert host_and_port('ugv1.local:1') == ('ugv1.local', 1)


@pytest.mark.parametrize('text', ['[fe80::1%wlan0]:17001', '::1:17001', '[2001:db8::7]:17001'])
def test_an_ipv6_address_is_refused_with_what_to_do(text: str) -> None:
    with pytest.raises(ValueError, match='uses IPv4 only, give an IPv4 address or a name that has one'):
        host_and_port(text)


@pytest.mark.parametrize('text', ['10.0.0.7', ':17001', '10.0.0.7:', '10.0.0.7:0', '10.0.0.7:65536', 'a:b', 'a:-1',
                                  'a:²', 'a:1e3', '%wlan0:1', 'a%:1'])
def test_what_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match='must be HOST:PORT, such as 10.0.0.7:17001') as error:
        host_and_port(text)
    assert repr(text) in str(error.value)


def judged(uri: str, robot: str = 'ugv1.local:17001', is_robots: bool = False) -> str:
    """What is said of a desk's ROS_MASTER_URI; empty: nothing."""
    addresses = {'ugv1.local': {7}, '10.0.0.7': {7}, '10.0.0.9': {9}}
    return foreign_master(uri, robot, is_robots, lambda host: host in ('localhost', 'desk'),
                          lambda host: addresses.get(host or '', set())) or ''


def test_a_desk_that_uses_the_robots_master_by_mistake_is_told() -> None:
    assert not judged('http://localhost:11311') and not judged('http://desk:11311/') and not judged('')
    for uri in ('http://10.0.0.7:11311', 'http://ugv1.local:11311/'):
        text = judged(uri)
        assert uri in text and 'ugv1.local:17001' in text and "the robot's own master" in text
        assert 'unset ROS_MASTER_URI' in text
    assert "another machine's master" in judged('http://10.0.0.9:11311')
    assert "another machine's master" in judged('http://nobody:11311')
    assert "the robot's own master" in judged('http://localhost:11311', is_robots=True)     # whatever it is called


SIDES = [(robot_transport, tables.ROBOT_SENDER, 'link_port'), (operator_transport, tables.OPERATOR_RECEIVER, 'robot')]


@pytest.mark.parametrize('make, table, name', SIDES)
def test_by_default_the_master_is_shared(monkeypatch: Any, log: Log, make: Any, table: Any, name: str) -> None:
    problems: List[str] = []
    transport = make(parameters(monkeypatch, table, {}, problems))
    assert not transport.own_masters and transport.stats(0.0) is None
    assert not problems and not log.warnings and not log.errors


@pytest.mark.parametrize('make, table, name', SIDES)
def test_who_was_given_a_key_does_not_share_a_master(
        monkeypatch: Any, log: Log, tmp_path: pathlib.Path, make: Any, table: Any, name: str) -> None:
    path = str(tmp_path / 'key')
    make_key(path)
    assert waits(log, monkeypatch, lambda: make(parameters(monkeypatch, table, {'key_file': path}, []))) == [
        'the link does not start, and this node waits: key_file needs %s: over a shared master all is sent in the '
        'clear' % name]


def test_the_robot_makes_a_key_and_shows_how_a_desk_gets_it(monkeypatch: Any, log: Log, home: pathlib.Path) -> None:
    path = home / '.ros' / 'smokebot_udp' / 'link.key'
    for begin in ('the link has a new key, ', 'the key of the link is '):
        robot_transport(parameters(monkeypatch, tables.ROBOT_SENDER, {'link_port': free_port()}, [])).close()
        found, = log.infos
        log.infos.clear()
        assert found.startswith('%s%s; on a desk that lacks it, run: mkdir -p ~/.ros/smokebot_udp && scp -p ' % (
            begin, path))
        assert found.endswith('@%s:%s ~/.ros/smokebot_udp/link.key' % (socket.gethostname(), path))
    assert len(read_key(str(path))) == 32 and path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700 and not log.errors and not log.warnings


def test_a_desk_without_a_key_says_what_to_do_and_waits_for_it(monkeypatch: Any, log: Log, home: pathlib.Path) -> None:
    path, made = home / '.ros' / 'smokebot_udp' / 'link.key', []
    given = parameters(monkeypatch, tables.OPERATOR_RECEIVER, {'robot': '127.0.0.1:17001'}, [])
    thread = threading.Thread(target=lambda: made.append(operator_transport(given)), daemon=True)
    thread.start()
    assert log.new_error.wait(WAIT) and not made and not path.exists()
    assert log.errors[0] == (
        'the link to 127.0.0.1:17001 does not start, and this node waits: this desk has no key of the robot, %s: run '
        'the command here that robot.launch shows on the robot, or, with its user, mkdir -p %s && scp -p '
        'USER@127.0.0.1:.ros/smokebot_udp/link.key %s' % (path, path.parent, path))
    make_key(str(path))
    thread.join(WAIT)
    made[0].close()


@pytest.mark.parametrize('make, table, name', SIDES)
def test_a_key_that_cannot_be_used_is_waited_for(
        monkeypatch: Any, log: Log, tmp_path: pathlib.Path, make: Any, table: Any, name: str) -> None:
    path, made = tmp_path / 'ugv1.key', []
    path.write_bytes(bytes(31))
    value: Any = free_port() if name == 'link_port' else '127.0.0.1:17001'
    given = parameters(monkeypatch, table, {name: value, 'key_file': str(path)}, [])
    thread = threading.Thread(target=lambda: made.append(make(given)), daemon=True)
    thread.start()
    assert log.new_error.wait(WAIT) and not made
    os.unlink(str(path))
    make_key(str(path))
    thread.join(WAIT)
    made[0].close()
    assert all('does not start, and this node waits: the key file' in error for error in log.errors)
    assert any('used by others' in error for error in log.errors)


def test_a_port_in_use_is_waited_for(monkeypatch: Any, log: Log) -> None:
    made: List[Any] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(('', 0))
        port = other.getsockname()[1]
        given = parameters(monkeypatch, tables.ROBOT_SENDER, {'link_port': port}, [])
        thread = threading.Thread(target=lambda: made.append(robot_transport(given)), daemon=True)
        thread.start()
        assert log.new_error.wait(WAIT) and not made
    thread.join(WAIT)
    made[0].close()
    assert len(log.errors) == 1 and 'port %d' % port in log.errors[0] and 'in use' in log.errors[0]


def test_an_address_without_a_port_is_said(monkeypatch: Any, log: Log) -> None:
    given = parameters(monkeypatch, tables.OPERATOR_RECEIVER, {'robot': '10.0.0.7'}, [])
    assert waits(log, monkeypatch, lambda: operator_transport(given)) == [
        "the link to 10.0.0.7 does not start, and this node waits: robot is '10.0.0.7', must be HOST:PORT, "
        'such as 10.0.0.7:17001 or 10.0.0.7%wwan0:17001']


def test_problems_name_the_robot_since_a_desk_may_have_several(monkeypatch: Any, log: Log, tmp_path: pathlib.Path
                                                               ) -> None:
    path, port = str(tmp_path / 'key'), free_port()
    make_key(path)
    robot = robot_transport(parameters(monkeypatch, tables.ROBOT_SENDER, {'link_port': port, 'key_file': path}, []))
    address = 'localhost:%d' % port
    other = str(tmp_path / 'other')
    make_key(other)
    operator = operator_transport(parameters(monkeypatch, tables.OPERATOR_RECEIVER, {
        'robot': address, 'key_file': other}, []))
    wait_for(lambda: any('key file' in error for error in log.errors))
    for transport in (operator, robot):
        transport.close()
    assert address + ': the robot has another key: copy its key file to this machine' in log.errors
