# SPDX-License-Identifier: BSD-3-Clause
from typing import List, Sequence

import pytest

from smokebot_udp.codecs.concealment.fill import BEST, METHODS
from smokebot_udp.streams.concealment_budget import CHEAPEST, FALLBACK, LONGEST_PERIOD, ConcealmentBudget

SLOW, QUICK = 0.08, 0.01
LIMIT = 0.05


def frames(budget: ConcealmentBudget, seconds: Sequence[float], now: float = 0.0, period: float = 0.1,
           limit: float = LIMIT, requested: str = BEST) -> List[str]:
    """Conceal a frame each `period`, which takes that many seconds unless it is cheap; the methods used."""
    used = []
    for took in seconds:
        budget.frame_began(int(now * 1e9))
        used.append(budget.method(requested, limit, now))
        took = took if used[-1] != CHEAPEST else QUICK
        budget.took(used[-1], took, now + took)
        now += period
    return used


def test_the_cheapest_is_a_method() -> None:
    assert CHEAPEST in METHODS


def test_a_quick_method_stays() -> None:
    assert frames(ConcealmentBudget(), [QUICK] * 50) == [BEST] * 50


def test_one_slow_frame_is_forgiven() -> None:
    assert frames(ConcealmentBudget(), [QUICK, SLOW, QUICK, SLOW, QUICK]) == [BEST] * 5


def test_two_slow_ones_in_a_row_are_not_and_it_is_tried_again_once() -> None:
    used = frames(ConcealmentBudget(), [SLOW] * 250)     # 25 s
    assert used[:3] == [BEST, BEST, CHEAPEST]
    tries = [i for i, method in enumerate(used) if method == BEST]
    assert len(tries) == 4 and tries[2] == pytest.approx(1 + FALLBACK / 0.1, abs=1) and tries[3] > tries[2] + 50


def test_it_comes_back_when_there_is_time_again() -> None:
    budget = ConcealmentBudget()
    frames(budget, [SLOW, SLOW])
    assert frames(budget, [QUICK] * 9, now=FALLBACK + 1) == [BEST] * 9


def test_a_fallback_is_reported_once_and_not_the_first_one() -> None:
    """While a node starts, everything takes longer."""
    budget = ConcealmentBudget()
    times = 0.1, 0.2, 0.3, 0.3 + FALLBACK, 0.4 + FALLBACK, 0.4 + 2 * FALLBACK
    reported = [budget.took(budget.method(BEST, LIMIT, now), SLOW, now) for now in times]
    assert reported == [False, False, False, True, False, False]
    budget = ConcealmentBudget()
    for now in times[:3]:
        budget.took(budget.method(BEST, LIMIT, now), SLOW, now)
    assert budget.falls_back(0.3) and not budget.falls_back(0.2 + FALLBACK)


@pytest.mark.parametrize('requested, limit', [(BEST, 2 * LIMIT), ('another', LIMIT)])
def test_another_request_ends_a_fallback(requested: str, limit: float) -> None:
    budget = ConcealmentBudget()
    assert frames(budget, [SLOW] * 3)[-1] == CHEAPEST
    assert budget.method(BEST, LIMIT, 0.5) == CHEAPEST
    assert budget.method(requested, limit, 0.5) == requested and not budget.falls_back(0.5)


def test_never_longer_than_the_frame_period() -> None:
    assert CHEAPEST in frames(ConcealmentBudget(), [SLOW] * 4, limit=9.0, period=0.05)
    assert CHEAPEST not in frames(ConcealmentBudget(), [SLOW] * 4, limit=9.0, period=0.1)


@pytest.mark.parametrize('strange', [-5.0, 0.0, LONGEST_PERIOD + 1])
def test_strange_intervals_do_not_count(strange: float) -> None:
    budget = ConcealmentBudget()
    assert CHEAPEST not in frames(budget, [SLOW] * 4, limit=9.0, period=0.1)
    budget.frame_began(int((0.3 + strange) * 1e9))
    assert [budget.took(budget.method(BEST, 9.0, now), SLOW, now) for now in (1.0, 2.0)] == [False, False]


def test_the_cheapest_has_no_fallback() -> None:
    budget = ConcealmentBudget()
    assert frames(budget, [SLOW] * 3, requested=CHEAPEST) == [CHEAPEST] * 3 and not budget.falls_back(0.3)
    assert [budget.took(CHEAPEST, SLOW, now) for now in (1.0, 2.0, 3.0)] == [False] * 3
