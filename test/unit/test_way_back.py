# SPDX-License-Identifier: BSD-3-Clause
"""What the experiment on the way back computes from what was sent and heard: values worked out by hand."""
import json
import math
import pathlib
from typing import Any, Dict, List

import numpy as np
import pytest

for library in ('cv2', 'matplotlib', 'tqdm'):
    pytest.importorskip(library)

from evaluation import way_back_results as results_of  # noqa: E402
from evaluation.way_back import air as air_use  # noqa: E402
from evaluation.way_back_results import Result, ages, results, stop_after, until_in_force  # noqa: E402
from experiments.link import way_back  # noqa: E402

SENT = [(number, 0.05 * number) for number in range(1, 6)]
STEADY = [(number, 0.05 * number) for number in range(1, 1011)]


def commands(heard: Any, **more: Any) -> Dict[str, Any]:
    return {'kind': 'commands', 'scene': 'lossy', 'sent': STEADY, 'heard': heard, 'since': 0.0, **more}


def by_what(raw: Dict[str, Any]) -> Dict[str, Result]:
    return {result.what: result for result in results([raw])}


def test_a_newer_command_is_as_good() -> None:
    # 2 is lost: 3 takes effect for it; nothing comes after 4
    heard = [(1, 0.11), (3, 0.20), (4, 0.27)]
    assert until_in_force(SENT, heard).tolist() == pytest.approx([0.06, 0.10, 0.05, 0.07, math.inf])
    assert ages(SENT, heard).tolist() == pytest.approx([0.06, 0.05, 0.07])


def test_an_older_command_is_no_newer_one() -> None:
    assert until_in_force(SENT[:3], [(1, 0.1), (3, 0.2), (2, 0.3)]).tolist() == pytest.approx([0.05, 0.10, 0.05])


def test_nothing_was_heard() -> None:
    assert until_in_force(SENT, []).tolist() == [math.inf] * 5 and not len(ages(SENT, []))
    assert not any(result.met for result in results([commands([], share=0.99, age=0.12)]))


def test_order() -> None:
    assert results_of.out_of_order([(1, 0.0), (0, 0.1), (3, 0.2), (3, 0.3), (2, 0.4), (4, 0.5)]) == 2


def test_commands_in_time_meet_their_goals() -> None:
    heard = [(number, at + 0.06) for number, at in STEADY if number % 2]
    in_force, age, order = results([commands(heard, share=0.99, age=0.12)])
    assert in_force.times == pytest.approx((0.11, 0.11, 0.11)) and in_force.found == '100.00 %'
    assert in_force.tried == 1000 and age.times == pytest.approx((0.06, 0.06, 0.06)) and order.found == '0, 0'
    assert in_force.met and age.met and order.met


def test_commands_that_are_late_old_or_out_of_order_miss_them() -> None:
    heard = [(number, at + 0.13) for number, at in STEADY]
    heard[-2:] = [(1010, 1010 * 0.05 + 0.4), (1009, 51.0)]
    in_force, age, order = results([commands(heard, share=0.99, age=0.12)])
    assert (in_force.found, order.found) == ('0.00 %', '1, 2')
    assert not (in_force.met or age.met or order.met)


def test_without_a_goal_lateness_is_only_reported() -> None:
    in_force, age, _ = results([commands([(number, at + 0.13) for number, at in STEADY])])
    assert in_force.met and age.met and (in_force.goal, age.goal) == ('', '')


def test_a_command_that_was_never_sent_is_too_old() -> None:
    assert results([commands([*STEADY[:5], (2000, 0.3)])])[2].found == '0, 1'


def test_only_commands_since_the_beginning_are_judged() -> None:
    assert results([commands([], since=25.001)])[0].tried == 500


def test_a_stop_comes_between_the_cut_and_its_end() -> None:
    heard = [(0, 0.9), (1, 1.0), (2, 1.05), (0, 1.6), (0, 1.65), (3, 2.2), (0, 2.5)]
    assert stop_after(1.02, 2.0, heard) == pytest.approx(0.58)
    assert stop_after(1.02, 1.5, heard) == math.inf
    assert stop_after(1.7, 2.4, heard) == math.inf


def stops(first_stop: float, again: int) -> Dict[str, Any]:
    return {'kind': 'stops', 'scene': 'cuts', 'sent': [(1, 0.9), (2, 1.9), (3, 3.0)], 'events': [(1.01, 2.0)],
            'heard': [(1, 1.0), (0, first_stop), (again, 3.1)]}


def test_a_stop_in_time_and_a_fresh_command_after_it() -> None:
    stop, fresh, order = results([stops(1.55, 3)])
    assert stop.met and stop.found == '1 of 1 within 550 ms' and stop.times == pytest.approx((0.54,) * 3)
    assert fresh.met and fresh.times == pytest.approx((0.1,) * 3) and order.met


def test_a_late_stop_and_an_old_command_after_it() -> None:
    stop, _, order = results([stops(1.57, 2)])
    assert not stop.met and stop.found.startswith('0 of 1') and order.found == '0, 1' and not order.met


def test_a_robot_that_never_moves_again_misses_the_goal() -> None:
    raw = stops(1.54, 0)
    assert [result.met for result in results([raw])] == [True, False, True]


def test_an_emergency_stop_is_in_force_in_time_and_until_it_is_released() -> None:
    tries = [(float(k), k + 0.2, k + 0.5, k + 0.6) for k in range(1000)]
    raw = {'kind': 'estops', 'scene': 'estop', 'tries': tries, 'heard': [(7, 0.21), (8, 0.5)]}
    assert all(result.met for result in results([raw]))
    raw['tries'] = [(1.0, 1.3, 1.5, 1.6), (2.0, None, 2.5, None), *tries[2:]]
    raw['heard'] = [(7, 10.3)]
    in_force, moved, released = results([raw])
    assert in_force.found == '99.80 %' and not in_force.met and in_force.times[2] == math.inf
    assert moved.found == '1' and not moved.met and released.times[2] == math.inf


def test_calls_are_executed_at_most_once() -> None:
    raw: Dict[str, Any] = {'kind': 'calls', 'scene': 'calls', 'executed': ['0', '1'], 'calls': [
        ('0', 0.0, 0.12, ''), ('1', 0.0, 10.0, 'no answer in 10 s'), ('2', 0.0, 10.0, 'no answer in 10 s')]}
    found = by_what(raw)
    assert found['reported as failed'].found == '2' and all(result.met for result in found.values())
    raw['executed'] += ['1']
    assert [result.met for result in results([raw])] == [False, True, True]
    raw['executed'] = []
    assert results([raw])[0].found == '0, 1'


@pytest.mark.parametrize('numbers, found', [
    ([0, 1, 2], '0, 0, 0'), ([0, 2], '1, 0, 0'), ([0, 1, 1, 2], '0, 1, 0'), ([0, 2, 1], '0, 0, 1'), ([], '3, 0, 0')])
def test_reliable_messages(numbers: List[int], found: str) -> None:
    raw = {'kind': 'reliable', 'scene': 'reliable', 'sent': [(k, 0.1 * k) for k in range(3)],
           'heard': [(number, 0.1 * number + 0.06) for number in numbers]}
    result, = results([raw])
    assert result.found == found and result.met == (found == '0, 0, 0')
    assert not numbers or result.times == pytest.approx((0.06,) * 3)


@pytest.mark.parametrize('lost, said, met', [
    (range(18, 40), ['22 given up'], [True, True]), (range(18, 40), [], [True, False]),
    (range(0), ['none'], [False, True]), (range(5, 40), ['35 given up'], [False, True]),
    ([*range(18, 40), 70], ['23 given up'], [False, True])])
def test_messages_are_given_up_during_a_cut_only(lost: Any, said: List[str], met: List[bool]) -> None:
    raw = {'kind': 'given up', 'scene': 'cut', 'sent': [(k, 0.1 * k) for k in range(80)], 'cut': 2.0, 'restored': 6.0,
           'heard': [(k, 0.1 * k + 0.06) for k in range(80) if k not in lost], 'max_age': 0.5, 'said': said}
    assert [result.met for result in results([raw])] == met


def air(name: str, age: float) -> Dict[str, Any]:
    return commands([(number, at + age) for number, at in STEADY], air=name, state={'used': 0.9})


def test_an_air_that_is_filled_may_delay_commands_by_little() -> None:
    last = results([air('idle', 0.06), air('filled', 0.079)])[-1]
    assert last.met and last.goal == 'p99 ≤ 80 ms' and last.found == 'images and commands use 90 % of the air'
    assert not results([air('idle', 0.06), air('filled', 0.081)])[-1].met


def test_use_of_the_air() -> None:
    before, after = ({'robot': {'carried': robot}, 'operator': {'carried': operator}, 'waited': {'operator': waited}}
                     for robot, operator, waited in ((1000, 10, {0: 5, 9: 1}), (1080, 30, {0: 103, 9: 2, 12: 1})))
    assert air_use(before, after, 1000.0) == {'used': 0.8, 'queue p99 [ms]': 12}
    assert air_use(after, after, 1000.0) == {'used': 0.0, 'queue p99 [ms]': 0}


def test_the_experiment_tells_what_was_missed(tmp_path: pathlib.Path) -> None:
    raws = [commands([(number, at + 0.13) for number, at in STEADY], share=0.99, age=0.12),
            {'kind': 'failed', 'scene': 'one air: air', 'error': 'no image comes: see nodes.log'}]
    (tmp_path / way_back.FILE).write_text(json.dumps(raws))
    assert way_back.missed(tmp_path) == [
        'lossy: in force, it or a newer one, within 120 ms: 0.00 %, goal: ≥ 99 %',
        'lossy: age of a command that takes effect: 130 / 130 / 130 ms, goal: p99 ≤ 120 ms',
        'one air: air: measured: no image comes: see nodes.log, goal: yes']
    figure, table = way_back.plot(tmp_path)
    assert (tmp_path / figure.name).exists()
    assert list(table.rows[2]) == [
        'lossy', 'out of order, or older than 300 ms', 1010, None, None, None, '0, 0', '0, 0', 'yes']


def test_a_scene_that_fails_does_not_stop_the_others() -> None:
    def broken(_: Any) -> Any:
        yield {'kind': 'commands'}
        raise RuntimeError('no image comes')
    scenes: Any = way_back.Scenes(way_back.Run(pathlib.Path(), True, 1), None, 'one air: ')
    assert list(way_back.measured(broken, scenes)) == [
        {'kind': 'commands'}, {'kind': 'failed', 'scene': 'one air: broken', 'error': 'no image comes'}]


def test_statistics() -> None:
    assert results_of.statistics(np.arange(1, 201)) == (101, 199, 200) and results_of.statistics([]) == ()
