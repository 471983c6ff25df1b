# SPDX-License-Identifier: BSD-3-Clause
import ast
import pathlib
from typing import Any, Iterator, List

import pytest
import rospy

from smokebot_udp import limited_log
from smokebot_udp.limited_log import BURST, ERROR_PERIOD, MAX_REMEMBERED, PERIOD, LogLimiter, kind_of, logerr, logwarn

SOURCE = pathlib.Path(__file__).resolve().parents[2] / 'src' / 'smokebot_udp'

DIRECT = {
    # once in the life of a process, a link or a stream
    'nodes/black_box.py', 'nodes/common.py', 'nodes/compiled_codec.py', 'demo/report.py',
    'nodes/operator_stream.py', 'nodes/trace.py', 'nodes/transports.py',
    'udpros/rospy_binding.py', 'link/transport.py', 'web/node.py',
    # once for each name, peer or outage, which they remember
    'nodes/namesake.py', 'nodes/reliable_link.py', 'udpros/connector.py', 'udpros/rpc.py',
    # a child process has ended; they wait longer and longer before the next start
    'nodes/launches.py', 'nodes/rviz_keeper.py',
    # the answer to a goal of a person, who sees no other
    'demo/simulated_driving.py',
    # a person engages or releases the emergency stop
    'nodes/robot_control.py',
}
"""Modules that log warnings or errors by rospy itself."""


def direct_logging(path: pathlib.Path) -> Iterator[str]:
    """What a module uses of rospy that logs warnings and errors."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == 'rospy':
            if node.attr.startswith(('logwarn', 'logerr', 'logfatal')):
                yield node.attr
        elif isinstance(node, ast.ImportFrom) and node.module == 'rospy':
            assert not any(alias.name.startswith('log') for alias in node.names), path


@pytest.fixture(name='lines')
def logged(monkeypatch: Any) -> List[str]:
    lines: List[str] = []
    for level in 'logerr', 'logwarn':
        monkeypatch.setattr(rospy, level, lambda text, *values, of=level: lines.append(of + ' ' + text % values))
    monkeypatch.setattr(rospy, 'is_shutdown', lambda: False)
    return lines


@pytest.fixture(name='clock')
def steady(monkeypatch: Any) -> List[float]:
    now = [100.0]
    monkeypatch.setattr('smokebot_udp.limited_log.time.monotonic', lambda: now[0])
    return now


def test_three_faulty_streams_write_a_line_each_a_period(lines: List[str], clock: List[float]) -> None:
    """At 10 Hz, each with numbers of its own in each text: 600 problems in 20 s."""
    for tick in range(200):
        clock[0] = 100 + 0.1 * tick
        for stream in 'front', 'rear', 'lidar':
            logerr("stream '%s'" % stream, "its stamp is %d.%09d like the last one's" % (tick, 7 * tick))
    assert len(lines) == 3 * 20 / ERROR_PERIOD
    assert lines[0] == "logerr stream 'front': its stamp is 0.000000000 like the last one's"
    assert lines[3] == ("logerr stream 'front': its stamp is 50.000000350 like the last one's "
                        "(and 49 more like it)")


def test_problems_that_alternate_are_two_kinds(lines: List[str], clock: List[float]) -> None:
    for tick in range(100):
        clock[0] = 100 + 0.04 * tick
        logerr('stream', 'height is 0' if tick % 2 else 'it has no ranges')
    assert lines == ['logerr stream: it has no ranges', 'logerr stream: height is 0']


def test_each_subject_counts_for_itself(lines: List[str], clock: List[float]) -> None:
    logwarn('one', 'lost')
    logwarn('other', OSError('lost'))
    assert lines == ['logwarn one: lost', 'logwarn other: lost']


@pytest.mark.parametrize('one, other', [
    ('data has 17 bytes, height x step is 4 x 9 = 36', 'data has 3 bytes, height x step is 4 x 9 = 36'),
    ('origin.x is 1.5e-07', 'origin.x is -4.25'),
    ('data of 8 bytes begins with 00ff: it is neither JPEG nor PNG', 'data of 2 bytes begins with 8a01: it is neither '
                                                                      'JPEG nor PNG')])
def test_texts_of_one_kind_differ_in_numbers_only(one, other) -> None:
    assert kind_of(one) == kind_of(other)
    assert kind_of('height is 0') != kind_of('width is 0')


def test_strangers_cannot_fill_the_log() -> None:
    """By names of their own: each is another subject."""
    limiter = LogLimiter()
    admitted = [limiter.admit('operator %d' % number, 'refused', 5.0, 0.01 * number) for number in range(3000)]
    assert sum(one is not None for one in admitted) <= BURST + 30 / PERIOD + 1


def test_only_so_many_kinds_are_remembered() -> None:
    limiter = LogLimiter()
    for number in range(MAX_REMEMBERED + 1):
        assert limiter.admit('stream %d' % number, 'broken', 1e9, 10.0 * number) == 0
    assert limiter.admit('stream 1', 'broken', 1e9, 1e5) is None
    assert limiter.admit('stream 0', 'broken', 1e9, 1e5) == 0       # forgotten


def test_what_the_budget_left_out_is_logged_later() -> None:
    limiter = LogLimiter()
    for number in range(BURST):
        assert limiter.admit('stream %d' % number, 'broken', 5.0, 1.0) == 0
    assert limiter.admit('last', 'broken', 5.0, 1.0) is None
    assert limiter.admit('last', 'broken', 5.0, 1.0 + PERIOD) == 0


def test_nothing_is_logged_while_the_node_shuts_down(lines: List[str], monkeypatch: Any) -> None:
    monkeypatch.setattr(rospy, 'is_shutdown', lambda: True)
    logerr('stream', 'broken')
    assert not lines


def test_a_thread_that_publishes_while_others_end_is_no_error(lines: List[str], monkeypatch: Any) -> None:
    monkeypatch.setattr(rospy.core, '_in_shutdown', True)       # in on_shutdown; rospy.is_shutdown() is still False
    logerr('stream', rospy.ROSException('publish() to a closed topic'))
    logerr('diagnostics', AttributeError("'NoneType' object has no attribute 'get_num_connections'"))
    assert not lines
    logerr('stream', 'the robot could not be stopped')
    assert len(lines) == 1


def test_a_new_start_logs_all_again(lines: List[str], clock: List[float]) -> None:
    for _ in range(2):
        logerr('stream', 'broken')
        limited_log.forget()
    assert len(lines) == 2


def test_problems_that_may_repeat_are_logged_by_the_limiter_only() -> None:
    """rospy's own throttles count by the line of code: one stream silences the others."""
    found = {str(path.relative_to(SOURCE)): set(direct_logging(path)) for path in SOURCE.rglob('*.py')
             if path != SOURCE / 'limited_log.py'}
    assert not {path: names for path, names in found.items() if names - {'logwarn', 'logerr'}}
    assert {path for path, names in found.items() if names} == DIRECT


def test_the_caller_learns_whether_it_is_logged(lines: List[str], clock: List[float]) -> None:
    assert logerr('stream', 'broken') and not logerr('stream', 'broken') and logwarn('other', 'broken')
    assert len(lines) == 2
