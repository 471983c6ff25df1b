# SPDX-License-Identifier: BSD-3-Clause
import pathlib
from typing import Any, List

import pytest

from benchmarks import stages as bench
from smokebot_udp.monitoring.stages import (
    ARRIVED,
    BOUND,
    BUDGET,
    ENCODED,
    PUBLISHED,
    RECEIVED,
    SEEN,
    STAMPED,
    STARTED,
    USED,
    Mark,
    Note,
    Stages,
    read_marks,
    read_notes,
)
from smokebot_udp.nodes.trace import Trace

POINTS = {STAMPED: 0.0, RECEIVED: 0.001, STARTED: 0.003, ENCODED: 0.01, SEEN: 0.02}


def marks(stamp: int, begin: float) -> List[Mark]:
    return [Mark('thermal', stamp, point, begin + after) for point, after in POINTS.items()]


def test_a_stage_lasts_from_one_mark_to_the_next_in_whatever_order_they_come() -> None:
    stages = Stages()
    for mark in reversed(marks(7, 100.0) + marks(8, 200.0)):
        stages.add(mark)
    durations = stages.durations('thermal')
    assert durations['source callback'] == pytest.approx([0.001] * 2)
    assert durations['wait for the encoder'] == pytest.approx([0.002] * 2)
    assert durations['encode'] == pytest.approx([0.007] * 2)
    assert durations['age'] == pytest.approx([0.02] * 2)
    assert durations['queue'] == durations['publish'] == [] and list(durations) == [stage for stage, _, _ in BUDGET]


def test_messages_of_other_streams_and_times_do_not_count() -> None:
    stages = Stages()
    for mark in marks(7, 100.0) + marks(8, 200.0) + marks(9, 300.0):
        stages.add(mark)
        stages.add(mark._replace(stream='camera'))
    assert len(stages.durations('thermal')['age']) == 3
    assert len(stages.durations('thermal', 150.0, 300.0)['age']) == 1
    assert not stages.durations('lidar')['age']


def test_a_message_that_was_lost_on_its_way_counts_up_to_there() -> None:
    stages = Stages()
    for mark in marks(7, 100.0)[:3]:
        stages.add(mark)
    durations = stages.durations('thermal')
    assert len(durations['wait for the encoder']) == 1 and not durations['encode'] and not durations['age']


def test_marks_are_read_as_they_were_written_and_torn_lines_left_out() -> None:
    written = [Mark('a b', 1600000000123456789, 'first sent', 12.345678), Mark('thermal', 0, ARRIVED, 0.0)]
    lines = [mark.line() for mark in written]
    torn = ['a\t7\tx', '\n', 'a\tb\tc\t1.0', 'a\t1\tc\tnan', 'a\t1\tc\t1.0\t2\n']
    assert list(read_marks([lines[0], *torn, lines[1]])) == written


def test_a_trace_is_appended_and_costs_nothing_without_a_file(tmp_path: pathlib.Path) -> None:
    Trace(None).mark('a', 1, RECEIVED)
    path = tmp_path / 'marks'
    for number in range(2):     # as of two nodes
        trace = Trace(str(path))
        assert trace.on
        trace.mark('thermal', number, RECEIVED, 1.5)
    trace.mark('thermal', 2, PUBLISHED)
    found = list(read_marks(path.read_text().splitlines(True)))
    assert found[:2] == [Mark('thermal', 0, RECEIVED, 1.5), Mark('thermal', 1, RECEIVED, 1.5)] and found[2].time > 0


def test_notes_are_read_beside_the_marks_of_the_same_file(tmp_path: pathlib.Path) -> None:
    trace = Trace(str(tmp_path / 'marks'))
    trace.mark('thermal', 7, RECEIVED, 1.5)
    trace.note('thermal', 7, USED, 3700)
    trace.note('thermal', 7, BOUND, '')
    lines = (tmp_path / 'marks').read_text().splitlines(True)
    assert list(read_marks(lines)) == [Mark('thermal', 7, RECEIVED, 1.5)]
    torn = ['thermal\t7\tused\t=1', 'thermal\tx\tused\t=1\n', 'thermal\t7\tused\n', '\n']
    assert list(read_notes([*torn, *lines])) == [Note('thermal', 7, USED, '3700'), Note('thermal', 7, BOUND, '')]


def test_a_file_that_cannot_be_written_is_one_error(tmp_path: pathlib.Path, monkeypatch: Any) -> None:
    errors: List[Any] = []
    monkeypatch.setattr('rospy.logerr', lambda *what: errors.append(what))
    trace = Trace(str(tmp_path / 'no' / 'folder'))
    for _ in range(3):
        trace.mark('thermal', 1, RECEIVED)
    assert len(errors) == 1 and not trace.on


def test_the_benchmark_joins_the_marks_of_the_nodes_with_what_the_sink_saw() -> None:
    stamp = 1600000000123456789
    seconds = stamp // 10 ** 9 + stamp % 10 ** 9 / 1e9
    offset = 1.6e9 - 50.0       # of ROS time
    nodes = [Mark(bench.STREAM, stamp, RECEIVED, 50.125), Mark(bench.STREAM, stamp, PUBLISHED, 50.130)]
    joined = bench.joined(nodes, {bench.SHOWN: [(seconds, 0.01, 5), (seconds + 1, 0.01, 5)],
                                  bench.VIEW: [(seconds, 0.02, 5)]}, offset)
    durations = joined.durations(bench.STREAM, 50.0, 51.0)
    assert durations['source callback'] == pytest.approx([50.125 - 50.123457], abs=1e-5)
    assert durations['subscriber'] == pytest.approx([0.003457], abs=1e-5)
    assert durations['age'] == pytest.approx([0.01]) and durations['age of the view'] == pytest.approx([0.02])


def test_the_budget_is_a_table_with_the_goals_beneath() -> None:
    none = {stage: None for stage, _, _ in BUDGET}
    rows = bench.table([{'case': 'interleaved', 'images': 3, 'goals': {'age': (8e-3, 15e-3)},
                         'stages': {**none, 'encode': {'p50': 0.0005, 'p99': 0.002},
                                    'age': bench.summary([0.008] * 3)}},
                        {'case': 'layered', 'images': 0, 'goals': {}, 'stages': none}]).splitlines()
    cells = {row.split('  ')[0]: row.split()[len(row.split('  ')[0].split()):] for row in rows[3:]}
    assert cells['encode'] == ['0.5', '2.0', '-'] and cells['queue'] == ['-', '-']
    assert cells['age'] == ['8.0', '8.0', '-']
    assert rows[[row.startswith('age ') for row in rows].index(True) + 1].split() == 'goal, at most 8.0 15.0 -'.split()
    assert bench.summary([]) is None
