# SPDX-License-Identifier: BSD-3-Clause
"""What the benchmarks compute from what they measure."""
import pathlib

import numpy as np
import pytest

from benchmarks import end_to_end, end_to_end_peer


def test_what_was_stamped_within_the_window_counts_whenever_it_arrives() -> None:
    sent = [0.9, 1.0, 1.5, 2.0, 2.5, 3.0]
    arrived = [(0.9, 0.05, 100), (1.0, 0.01, 100), (1.5, 0.03, 50), (2.5, 9.0, 100), (3.0, 0.01, 100)]
    assert end_to_end.stats(sent, arrived, 100, (1.0, 3.0)) == {
        'sent': 4, 'came': 3, 'rate': 1.5, 'whole': 250 / 400, 'p50': 0.03, 'p99': pytest.approx(0.03 + 0.98 * 8.97)}


def test_without_arrivals_there_is_no_age() -> None:
    assert end_to_end.stats([1.0], [], 100, (0.0, 2.0)) == {
        'sent': 1, 'came': 0, 'rate': 0.0, 'whole': 0.0, 'p50': None, 'p99': None}
    assert end_to_end.stats([], [], 100, (0.0, 2.0))['whole'] is None


def test_lost_datagrams_are_counted_once_though_stream_and_connection_report_them() -> None:
    assert end_to_end.lost_in([
        ('image', {'side': 'operator', 'lost': '7', 'kernel drops': '3'}),
        ('image, /robot_sender', {'peer': '/robot_sender', 'lost': '7'}),
        ('cloud', {'lost': '2'}), ('clock', {}), ('settings', {'side': 'operator'})]) == 9
    assert end_to_end.lost_in([('image', {'side': 'robot', 'dropped, wrong': '1',
                                          'dropped, datagrams of replaced messages': '5'})]) == 5


def test_rounds_give_their_medians_and_the_sums_of_counts() -> None:
    rounds = [{'robot': 0.2, 'image.p99': None, 'image.sent': 10, 'image.came': 9, 'lost': 1},
              {'robot': 0.9, 'image.p99': 0.03, 'image.sent': 11, 'image.came': 11, 'lost': 0},
              {'robot': 0.3, 'image.p99': 0.01, 'image.sent': 10, 'image.came': 10, 'lost': 2}]
    assert end_to_end.median(rounds) == {'robot': 0.3, 'image.p99': 0.02, 'image.sent': 31, 'image.came': 30, 'lost': 3}
    assert end_to_end.median([{'lost': None}])['lost'] is None


def test_the_table_shows_each_goal_beneath_what_was_measured() -> None:
    measured = {'robot': 0.251, 'operator': 0.349, 'source': 0.05, 'sink': 0.06, 'lost': 3, 'image.rate': 9.97,
                'image.whole': 0.9951, 'image.p50': 0.0089, 'image.p99': 0.01234}
    rows = end_to_end.table([
        {'load': end_to_end.IMAGES, 'way': 'ours', 'goals': {'image.p99': 15e-3, 'lost': 0}, 'measured': measured},
        {'load': end_to_end.IMAGES, 'way': 'theirs', 'goals': {}, 'measured': {'robot': 0.5}}]).splitlines()
    at = rows.index(end_to_end.IMAGES)
    assert rows[at + 2].split() == 'robot operator source sink lost [1/s] came [%] p50 [ms] p99 [ms]'.split()
    assert rows[at + 3].split() == 'ours 0.25 0.35 0.05 0.06 3 10.0 99.5 8.9 12.3'.split()
    assert rows[at + 4].split() == 'goal, at most - - - - 0 - - - 15.0'.split()
    assert rows[at + 5].split() == ['theirs', '0.50'] + ['-'] * 8


def test_every_case_has_a_method_and_goals_for_what_is_measured(tmp_path: pathlib.Path) -> None:
    methods = {method.name for method in end_to_end.methods(tmp_path)}
    for case in end_to_end.CASES:
        kinds = end_to_end.LOADS[case.load]
        known = set(end_to_end.COLUMNS) | {'%s.%s' % (kind, name) for kind in kinds for name in end_to_end.KIND_COLUMNS}
        assert case.method in methods and set(case.goals) <= known


def test_the_views_differ() -> None:
    views = end_to_end_peer.views()
    assert len(views) == end_to_end_peer.VIEWS and views[0].dtype == np.uint16
    for view, following in zip(views, views[1:] + views[:1]):
        assert np.mean(view == following) < 0.1
