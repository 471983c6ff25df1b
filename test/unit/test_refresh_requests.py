# SPDX-License-Identifier: BSD-3-Clause
"""When a video begins anew for an operator."""
from typing import Any, List, Sequence, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.streams.held import Holding
from smokebot_udp.streams.image.refresh_requests import (
    FIRST_RETRY,
    LAST_RETRY,
    LONG,
    RefreshRequests,
)

SESSION = 7


def holding(*runs: Tuple[int, int], session: int = SESSION) -> Holding:
    return Holding(session, tuple(runs))


def started(operators: Sequence[str] = ('desk',), images: int = 10, period: float = 0.1) -> RefreshRequests:
    """That has sent images 0, 1, ... at 0.0, 0.1 s, ..., the first one as a beginning."""
    requests = RefreshRequests()
    requests.serve(operators, 0.0)
    for number in range(images):
        requests.sent(SESSION, number, number == 0, number * period)
    return requests


def test_each_operator_that_joins_gets_a_beginning_once() -> None:
    requests = RefreshRequests()
    assert not requests.wanted()
    requests.serve(['desk'], 0.0)
    assert requests.wanted()
    requests.sent(SESSION, 0, False, 0.0)       # it was not one, for whatever reason
    assert requests.wanted()
    requests.sent(SESSION, 1, True, 0.1)
    requests.serve(['desk'], 0.2)
    assert not requests.wanted()
    requests.serve(['desk', 'tablet'], 0.3)
    assert requests.wanted()
    requests.serve(['desk'], 0.4)               # it has left
    assert not requests.wanted()


def begun(requests: RefreshRequests, operator: str, times: Sequence[float]) -> List[float]:
    """When images that are sent at these times are beginnings."""
    found = []
    for number, now in enumerate(times):
        requests.serve([operator], now)
        if requests.wanted():
            found.append(now)
        requests.sent(SESSION, number, requests.wanted(), now)
    return found


def test_an_operator_that_has_never_reported_gets_a_beginning_ever_more_seldom() -> None:
    found = begun(RefreshRequests(), 'desk', [0.1 * step for step in range(1000)])
    assert np.diff(found) == pytest.approx([2 * FIRST_RETRY * 2 ** step for step in range(len(found) - 1)], abs=0.11)
    assert found[0] == 0.0 and found[-1] > 30


def test_an_operator_that_has_reported_gets_another_beginning_for_its_reports_only() -> None:
    requests = started()
    requests.held('desk', holding((0, 10)), 0.9)
    assert begun(requests, 'desk', [1.0 + 0.1 * step for step in range(1000)]) == []


def test_who_holds_what_was_sent_of_late_needs_nothing() -> None:
    requests = started()
    requests.held('desk', holding((0, 10)), 0.9)
    for newest in (9, 8, 5):                    # 5: image 6 was sent 0.5 s ago
        requests.held('desk', holding((0, newest + 1)), 0.6 + LONG)
        assert not requests.wanted()
    requests.held('desk', holding((0, 5)), 0.6 + LONG)
    assert requests.wanted()


@pytest.mark.parametrize('delay', [0.1, 0.7, 1.5])
def test_reports_that_take_long_are_no_loss(delay: float) -> None:
    requests, begun = started(images=1), []
    for step in range(1, 300):
        now, received = 0.1 * step, int(10 * (0.1 * step - delay) + 0.5)
        if 0 <= received < 200:                 # nothing arrives from then on
            requests.held('desk', holding((0, received + 1)), now)
        elif received >= 200:
            requests.held('desk', holding((0, 200)), now)
        if requests.wanted():
            begun.append(now)
        requests.sent(SESSION, step, requests.wanted(), now)
    assert begun and 20.0 + delay + LONG - 0.11 < begun[0] < 20.0 + 2 * delay + LONG + 0.3


def test_a_beginning_that_is_too_large_is_not_tried_at_once_again() -> None:
    requests = RefreshRequests()
    requests.serve(['desk'], 0.0)
    requests.too_large(0.0)
    requests.serve(['desk'], 0.1)
    assert not requests.wanted()
    requests.sent(SESSION, 1, False, 0.1)
    requests.held('desk', holding(), 0.2)
    assert not requests.wanted()
    requests.held('desk', holding(), 0.1 + 2 * FIRST_RETRY)
    assert requests.wanted()


def test_who_has_lost_everything_gets_a_beginning_at_the_next_report() -> None:
    requests = started()
    requests.held('desk', holding(), 1.0)
    assert requests.wanted()


def test_of_a_former_session_nothing_helps() -> None:
    requests = started()
    requests.held('desk', holding((0, 100), session=SESSION + 1), 0.4)
    assert not requests.wanted()                # the new one has just begun
    requests.held('desk', holding((0, 100), session=SESSION + 1), 0.9)
    assert requests.wanted()


def test_it_is_retried_more_and_more_rarely_until_the_reports_change() -> None:
    requests, begun, now = started(), [], 0.9
    for step in range(4000):
        now += 0.01
        requests.held('desk', holding(), now)
        if requests.wanted():
            requests.sent(SESSION, 10 + step, True, now)
            begun.append(now)
    gaps = [after - before for before, after in zip(begun, begun[1:])]
    assert FIRST_RETRY <= gaps[0] < FIRST_RETRY * 2 + 0.05
    assert all(after > before - 0.05 for before, after in zip(gaps, gaps[1:]))
    assert LAST_RETRY <= gaps[-1] < LAST_RETRY + 0.05
    requests.held('desk', holding((10, 1)), begun[-1] + 1.1 * FIRST_RETRY)
    assert requests.wanted()


def test_reports_of_who_is_not_served_or_before_anything_was_sent_change_nothing() -> None:
    requests = started()
    requests.held('stranger', holding(), 5.0)
    assert not requests.wanted()
    fresh = RefreshRequests()
    fresh.held('desk', holding(), 5.0)
    assert not fresh.wanted()


@given(st.lists(st.tuples(st.sampled_from(['desk', 'tablet']), st.lists(st.integers(0, 40), max_size=5),
                          st.floats(0.01, 0.3)), max_size=80))
def test_beginnings_are_apart_whatever_is_reported(reports: Any) -> None:
    requests, now, begun = started(['desk', 'tablet']), 1.0, []
    for step, (name, numbers, passed) in enumerate(reports):
        now += passed
        requests.held(name, Holding.of(SESSION, numbers), now)
        if requests.wanted():
            begun.append(now)
        requests.sent(SESSION, 10 + step, requests.wanted(), now)
    for before, after in zip(begun, begun[2:]):     # of two operators
        assert after - before >= FIRST_RETRY
