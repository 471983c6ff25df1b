# SPDX-License-Identifier: BSD-3-Clause
"""Requests are sent until they are answered, and carried out once."""
import math
from typing import List

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.records import Wish
from smokebot_udp.teleop.requests import (
    MAX_OUTCOMES,
    SUPERSEDED,
    TIMEOUT,
    UNANSWERED,
    Answers,
    RequestClient,
)


def sendings(client: RequestClient, until: float) -> List[float]:
    """When the pending request is sent."""
    times = []
    while client.deadline() <= until:
        now = client.deadline()
        if client.poll(now) is not None:
            times.append(round(now, 6))
    return times


@given(st.lists(st.integers(1, 30), max_size=60))
def test_each_id_is_carried_out_once_and_never_after_a_higher_one(ids: List[int]) -> None:
    answers, done = Answers(), []
    for request in ids:
        if answers.take(request):
            done.append(request)
            answers.answer(request, 'no' if request % 2 else None)
        assert answers.answered == max(done) and answers.refusal == ('no' if max(done) % 2 else '')
    assert done == sorted(set(done)) and set(done) == {max(ids[:n + 1]) for n in range(len(ids))}


def test_five_copies_within_20_ms_then_50_a_second() -> None:
    client = RequestClient()
    client.ask(Wish.ENGAGE_ESTOP, 0, 0.0, 100.0)
    assert sendings(client, 100.11) == [100.0, 100.005, 100.01, 100.015, 100.02, 100.04, 100.06, 100.08, 100.1]
    assert client.answered(1, '') == Wish.ENGAGE_ESTOP
    assert client.deadline() == math.inf and client.poll(101.0) is None and client.outcome(1) == ''


def test_an_emergency_stop_is_never_given_up_anything_else_is() -> None:
    client = RequestClient()
    take = client.ask(Wish.TAKE_CONTROL, 7, 50.0, 100.0)
    copies = sendings(client, 100.0 + TIMEOUT)
    assert len(copies) == pytest.approx(5 + (TIMEOUT - 0.02) / 0.02, abs=1.5) and client.outcome(take) == UNANSWERED
    client.ask(Wish.ENGAGE_ESTOP, 0, 0.0, 200.0)
    assert len(sendings(client, 260.0)) == pytest.approx(50 * 60, abs=5)


def test_a_sender_that_wakes_late_catches_up_but_sends_no_heap() -> None:
    client = RequestClient()
    client.ask(Wish.ENGAGE_ESTOP, 0, 0.0, 100.0)
    times = [now for now in (100.0, 100.013, 100.026, 100.039, 100.5, 100.5, 100.5) if client.poll(now) is not None]
    assert times == [100.0, 100.013, 100.026, 100.039, 100.5, 100.5]


def test_requests_are_answered_one_after_the_other() -> None:
    client = RequestClient()
    take = client.ask(Wish.TAKE_CONTROL, 7, 50.0, 100.0)
    release = client.ask(Wish.RELEASE_CONTROL, 7, 50.1, 100.1)
    pending = client.poll(100.2)
    assert pending is not None and (pending.id, pending.robot, pending.made) == (take, 7, 50.0)
    assert client.answered(release, '') is None and client.answered(99, '') is None
    assert client.answered(take, 'no') == Wish.TAKE_CONTROL and client.answered(take, '') is None
    assert (client.outcome(take), client.outcome(release)) == ('no', None)
    pending = client.poll(100.2)
    assert pending is not None and pending.id == release


def test_an_emergency_stop_supersedes_all_others() -> None:
    client = RequestClient()
    others = [client.ask(Wish.RELEASE_ESTOP, 7, 50.0, 100.0), client.ask(Wish.TAKE_CONTROL, 7, 50.0, 100.0)]
    stop = client.ask(Wish.ENGAGE_ESTOP, 0, 0.0, 100.1)
    assert client.pending is not None and client.pending.id == stop > max(others)
    assert [client.outcome(other) for other in others] == [SUPERSEDED, SUPERSEDED]
    after = client.ask(Wish.RELEASE_ESTOP, 7, 50.2, 100.2)      # waits until the robot has answered the stop
    assert client.pending.id == stop and after > stop
    assert client.ask(Wish.ENGAGE_ESTOP, 0, 0.0, 100.3) > after and client.outcome(after) == SUPERSEDED


@pytest.mark.parametrize('wish', list(Wish)[1:])
def test_what_is_asked_once_more_has_an_id_and_a_time_of_its_own_and_one_outcome(wish: Wish) -> None:
    client = RequestClient()
    first, second = client.ask(wish, 7, 50.0, 100.0), client.ask(wish, 7, 50.4, 100.4)
    pending = client.poll(100.4)
    assert pending is not None and (pending.id, pending.made) == (second, 50.4) and second > first
    assert client.answered(first, '') is None       # the robot has carried that out, but not this
    assert (client.outcome(first), client.outcome(second)) == (None, None)
    assert client.answered(second, 'no') == wish and client.pending is None
    assert (client.outcome(first), client.outcome(second)) == ('no', 'no')


def test_a_stop_that_is_asked_once_more_is_not_superseded() -> None:
    client = RequestClient()
    stop, release = client.ask(Wish.ENGAGE_ESTOP, 0, 0.0, 100.0), client.ask(Wish.RELEASE_ESTOP, 7, 50.1, 100.1)
    again = client.ask(Wish.ENGAGE_ESTOP, 0, 0.0, 100.2)
    assert (client.outcome(stop), client.outcome(release)) == (None, SUPERSEDED)
    client.answered(again, '')
    assert client.outcome(stop) == ''


def test_what_waits_and_what_is_remembered_is_bounded() -> None:
    client = RequestClient()
    asked = [client.ask(list(Wish)[1 + number % 4], 7, 50.0, 100.0) for number in range(1000)]
    assert sum(client.outcome(request) is None for request in asked) <= 4 * (1 + MAX_OUTCOMES)
    first = client.ask(Wish.ENGAGE_ESTOP, 0, 0.0, 100.0)
    client.answered(first, '')
    for _ in range(MAX_OUTCOMES):
        client.answered(client.ask(Wish.TAKE_CONTROL, 7, 50.0, 100.0), 'no')
    assert client.outcome(first) == UNANSWERED
