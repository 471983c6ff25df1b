# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Dict

from evaluation.live_goals import missed
from evaluation.live_score import Row

CELL = 'tbf6, 1 Mbit/s, %g %%'


def a_row(method: str, loss: float, mean: float, **others: Any) -> Row:
    """The row of a method whose images are steady."""
    return {'cell': CELL % loss, 'method': method, 'loss [%]': loss, 'image mean [dB]': mean,
            'image 5 % [dB]': mean - 1, 'image worst [dB]': mean - 2, 'screen mean [dB]': mean - 2, 'age p50 [s]': 0.07,
            'used while blurred': 0.9, 'capacity known': 1.0, **others}


def results(*rows: Row, **others: Any) -> Dict[str, Any]:
    return {'rows': rows, 'steps': [], 'idle': [], **others}


def test_what_is_reached_or_was_not_measured_is_not_missed() -> None:
    assert missed(results(a_row('ours', 0, 40.0))) == []
    assert missed(results(a_row('ours', 0, 40.0), a_row('ideal', 0, 40.9), a_row('gst', 0, 40.0))) == []
    assert missed(results(a_row('ours', 5, 40.0), a_row('gst', 5, 33.0), a_row('fec', 5, 39.9))) == []
    assert missed(results(a_row('layered', 0, 10.0), a_row('gst', 0, 40.0))) == []


def test_who_is_behind_the_ideal_or_any_peer_is_named() -> None:
    found = missed(results(a_row('ours', 50, 36.0), a_row('ideal', 50, 37.1), a_row('gst', 50, 30.0),
                           a_row('srt', 50, 36.5)))
    assert found == [CELL % 50 + ': the screen, beside the ideal one [dB] is 34, should be at least 34.1',
                     CELL % 50 + ': the screen, beside srt [dB] is 34, should be at least 34.5']


def test_images_that_pulsate_are_named_up_to_20_percent_of_loss() -> None:
    pulsating = {'image 5 % [dB]': 37.9, 'image worst [dB]': 33.9}
    assert len(missed(results(a_row('ours', 20, 40.0, **pulsating)))) == 2
    assert missed(results(a_row('ours', 50, 40.0, **pulsating))) == []


def test_age_counts_where_nothing_is_lost_and_the_lead_where_something_is() -> None:
    rows = [a_row('ours', 0, 40.0, **{'age p50 [s]': 0.2}), a_row('gst', 0, 39.0),
            a_row('ours', 5, 40.0, **{'age p50 [s]': 0.2}), a_row('gst', 5, 37.5), a_row('rtx', 5, 39.0)]
    assert [line.split(': ')[1].split(' is ')[0] for line in missed(results(*rows))] == [
        'the age p50 [s]', 'image mean [dB], beside plain GStreamer', 'image 5 % [dB], beside plain GStreamer']


def test_an_empty_link_and_an_unknown_capacity_are_named() -> None:
    assert len(missed(results(a_row('ours', 0, 40.0, **{'used while blurred': 0.8, 'capacity known': 0.9})))) == 2
    assert missed(results(a_row('ours', 0, 43.0, **{'used while blurred': None}))) == []


def test_steps_are_to_be_over_soon_and_nothing_beside_the_images_is_to_take_much() -> None:
    def step(rate: float, oldest: float, after: Any) -> Row:
        return {'cell': 'steps', 'method': 'ours', 'rate': rate, 'oldest [s]': oldest, 'steady after [s]': after}
    assert missed(results(steps=[step(3, 9.0, None), step(0.5, 0.4, 1.0), step(3, 0.4, 2.0)])) == []
    assert len(missed(results(steps=[step(3, 0.1, 0.1), step(0.5, 0.5, 1.1), step(3, 0.1, None)]))) == 3
    idle = {'cell': 'idle', 'streams': 'camera', 'link [Mbit/s]': 0.3}
    assert missed(results(idle=[{**idle, 'to operator then [kbit/s]': 9.0}])) == []
    assert len(missed(results(idle=[{**idle, 'to operator then [kbit/s]': 40.0}]))) == 1
    assert missed(results(idle=[{**idle, 'streams': 'none', 'to operator then [kbit/s]': 40.0}])) == []
