# SPDX-License-Identifier: BSD-3-Clause
"""What the experiments over the link compute from what was heard: values worked out by hand."""
import json
import math
import pathlib
from typing import Any, Dict, List

import numpy as np
import pytest

for library in ('cv2', 'matplotlib', 'tqdm'):
    pytest.importorskip(library)

from evaluation import TOP, sensor_source  # noqa: E402
from evaluation.linear_fit import linear_fit  # noqa: E402
from evaluation.link_run import IMAGE_METHODS, LabBusy, repeated, summary  # noqa: E402
from evaluation.listener import Heard  # noqa: E402
from experiments import drawing, table  # noqa: E402
from experiments.link import hostile, own_masters, traces  # noqa: E402
from experiments.link.start_up import EVENTS, starts  # noqa: E402
from experiments.link.traces import shown  # noqa: E402
from experiments.runner import Table  # noqa: E402
from smokebot_udp.streams import config  # noqa: E402


def test_linear_fit() -> None:
    assert linear_fit([0, 50, 100], [64, 32, 0]) == pytest.approx((-0.64, 64, 1))


def test_how_well_a_line_fits() -> None:
    # x - 1.5 is -1.5 -0.5 0.5 1.5, y - 1 is -1 -1 1 1: the slope is (1.5 + 0.5 + 0.5 + 1.5) / 5,
    # and the line is off by 0.2 -0.6 0.6 -0.2
    slope, intercept, fit = linear_fit([0, 1, 2, 3], [0, 0, 2, 2])
    assert (slope, intercept) == pytest.approx((0.8, -0.2))
    assert fit == pytest.approx(1 - (0.04 + 0.36 + 0.36 + 0.04) / 4)


def test_rate_and_ages_of_what_arrived() -> None:
    heard = [Heard('image', 0.1 * i, 0.1 * i + 0.01 * (i + 1), 1000 + i) for i in range(4)]
    assert summary(heard, 2.0) == {'rate [Hz]': 2.0, 'age p50 [s]': 0.025, 'age p99 [s]': 0.04, 'amount': 1001.5}


@pytest.mark.parametrize('attempts, found', [
    ([0.3], (0, 1)), ([25.0, 0.3], (1, 2)), ([None, 0.3], (1, 2)), ([25.0, None, 30.0, 0.3], (2, 3)),
    ([25.0, 0.3, None], (1, 2)), ([0.3, None, None], (0, 1)), ([None, None, None], None), ([25.0, 25.0, None], None)])
def test_a_cell_is_measured_again_where_the_machine_was_busy(attempts: List[Any], found: Any) -> None:
    left = list(enumerate(attempts))

    def measure() -> Any:
        number, late = left.pop(0)
        if late is None:
            raise LabBusy('the lab itself lost 7 packets')
        return number, {'late p99 [ms]': late}

    if found is None:
        with pytest.raises(LabBusy):
            repeated(measure)
    else:
        number, state = repeated(measure)
        assert (number, state['attempts']) == found and len(left) == len(attempts) - found[1]


def test_nothing_arrived() -> None:
    assert summary([], 2.0) == {'rate [Hz]': 0.0, 'age p50 [s]': None, 'age p99 [s]': None, 'amount': None}


def test_what_is_shown_over_time() -> None:
    stamps, arrivals = np.array([0.0, 0.5, 1.0]), np.array([0.2, 0.7, 3.0])
    rates, ages = shown(stamps, arrivals, np.array([0.1, 1.0, 2.0, 3.0]))
    assert rates.tolist() == [0, 2, 0, 1]
    assert np.isnan(ages[0])
    assert ages[1:].tolist() == [0.5, 1.5, 2.0]


def test_a_start_ends_with_the_last_stream_that_has_to_arrive() -> None:
    start, restart, _ = EVENTS
    waits: List[Dict[str, Any]] = [
        {'seed': seed, 'event': event, 'stream': stream, 'wait [s]': wait} for seed, event, stream, wait in (
            (1, start, 'thermal', 5.0), (1, start, 'camera', 4.0), (1, start, 'map', 9.0),
            (2, start, 'thermal', 6.0), (2, start, 'camera', None),
            (1, restart, 'thermal', 3.0), (1, restart, 'camera', 2.0), (1, restart, 'map', 60.0))]
    assert starts(waits) == dict(zip(EVENTS, ([(4.0, 9.0), (6.0, math.inf)], [(2.0, 3.0)], [])))


def test_image_methods_have_a_colour_a_source_and_a_stream_of_their_own() -> None:
    assert set(IMAGE_METHODS) <= set(drawing.COLOURS)
    streams, problems = config.load((TOP / 'evaluation' / 'link_streams.yaml').read_text())
    coding = {settings['operator_topic']: settings['coding'] for settings in streams.values()
              if settings['type'] == 'image'}
    ours = {**IMAGE_METHODS, **traces.METHODS}
    assert not problems and {name: coding['/' + method.subscriptions[0][0]] for name, method in ours.items()
                             if name.startswith('smokebot_udp')} == {
        'smokebot_udp': 'auto', 'smokebot_udp, interleaved': 'interleaved', 'smokebot_udp, layered': 'layered'}
    assert set(traces.METHODS) <= set(drawing.COLOURS)
    assert {method.source for method in ours.values()} <= set(sensor_source.TOPICS)


def test_own_masters_goals_are_of_medians_and_of_the_worst(tmp_path: pathlib.Path) -> None:
    waits = [('both start', 1, 0.9, 1.9), ('both start', 2, 2.6, 2.1), ('both start', 3, 0.8, 1.0),
             ('robot restarts', 1, 1.1, 9.0), ('cut', 1, 0.5, 9.0)]
    table.write(tmp_path / 'waits.csv', [
        {'seed': seed, 'event': event, 'stream': stream, 'wait [s]': wait} for event, seed, image, last in waits
        for stream, wait in (('thermal', image), ('camera', image + 1), ('battery', last))])
    first, second, third = own_masters.times(tmp_path)
    assert first == ('both start', [0.8, 0.9, 2.6], [1.8, 1.9, 3.6])
    assert (second.event, third.event) == ('robot restarts', 'cut')
    assert own_masters.missed(tmp_path) == ['both start: first image, worst 2.60 s, at most 2.5 s',
                                            'robot restarts: first image, median 1.10 s, at most 1 s']


def test_a_stream_that_never_comes_misses_the_goal(tmp_path: pathlib.Path) -> None:
    table.write(tmp_path / 'waits.csv', [{'seed': 1, 'event': 'cut', 'stream': stream, 'wait [s]': None}
                                         for stream in ('thermal', 'camera')])
    assert own_masters.missed(tmp_path) == ['cut: first image, median inf s, at most 1 s']


def test_an_attack_may_slow_images_and_fill_memory_by_little(tmp_path: pathlib.Path) -> None:
    phases = [{'name': name, 'seconds': 5.0, 'rate': rate, 'age': 0.1, 'growth': {'robot': growth, 'operator': 0.0},
               'sent': {'mutated': 7}, 'dropped': {'forged': 2, 'malformed': 5}}
              for name, rate, growth in (('quiet', 10.0, 0.0), ('flood', 9.4, 11e6))]
    (tmp_path / 'phases.json').write_text(json.dumps(phases))
    assert hostile.missed(tmp_path) == ['flood: 9.4 images a second', 'flood: robot grew by 11.0 MB']
    _, sent = hostile.plot(tmp_path)
    assert isinstance(sent, Table) and sent.rows[1] == ['flood', 'mutated: 7', 'malformed: 5, forged: 2']
