# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, List

import pytest

from smokebot_udp.streams.image.coding_choice import (
    EXPLORATION,
    FITS,
    HOLD,
    MEASURED,
    QUICK,
    RETRY,
    TRIAL,
    TRIAL_INTERVAL,
    CodingChoice,
    Conditions,
)

FAST, SLOW = 1e7, 1e6       # links [byte/s]


def conditions(raw: float = 2e6, room: float = FAST, loss: Any = 0.0, period: float = 0.1) -> Conditions:
    return Conditions(raw, room, loss, period)


@pytest.mark.parametrize('now, layered', [
    (conditions(), False),
    (conditions(room=float('inf')), False),
    (conditions(raw=float('inf'), room=float('inf')), True),    # they may not be so large
    (conditions(room=SLOW), True),                  # raw pixels do not fit
    (conditions(raw=0.9 * FAST), True),             # they do, without time to spare
    (conditions(loss=0.05), True),
    (conditions(loss=None), True),                  # plan for the worst
])
def test_the_first_image_is_coded_as_its_link_is(now: Conditions, layered: bool) -> None:
    assert CodingChoice().update(now, 5.0) is layered


def test_a_link_that_gets_worse_counts_at_once_and_one_that_gets_better_after_a_while() -> None:
    choice = CodingChoice()
    assert not choice.update(conditions(), 0.0)
    assert choice.update(conditions(room=SLOW), 0.1)
    assert choice.update(conditions(), 0.2) and choice.update(conditions(), 0.1 + HOLD)
    assert choice.update(conditions(loss=0.2), 5.15)        # the time begins anew
    assert choice.update(conditions(), 5.2) and choice.update(conditions(), 5.1 + HOLD)
    assert not choice.update(conditions(), 5.3 + HOLD)


def test_neither_loss_nor_bandwidth_near_the_limit_changes_it_to_and_fro() -> None:
    choice, chosen = CodingChoice(), []
    for step in range(300):
        near = conditions(raw=(QUICK / 0.1 + 0.05 * (step % 2)) * FAST, loss=0.005 + 0.015 * (step % 3 == 0))
        chosen.append(choice.update(near, 0.1 * step))
    assert len([1 for before, after in zip(chosen, chosen[1:]) if before != after]) <= 1


LOSSY = conditions(loss=0.05)


def run(choice: CodingChoice, duration: float, images: int, start: float, link: Conditions = LOSSY) -> List[bool]:
    """Layered images that take so long, ten a second [s]."""
    chosen = []
    for number in range(images):
        chosen.append(choice.update(link, start + 0.1 * number))
        if chosen[-1]:
            choice.took(duration)
    return chosen


def test_a_processor_that_is_too_slow_interleaves_and_tries_again_later() -> None:
    choice = CodingChoice()
    chosen = run(choice, 0.12, 20, 0.0)
    assert chosen == [True] * (MEASURED + 1) + [False] * (19 - MEASURED)    # the first one loads the code
    assert not any(run(choice, 0.12, 10, 0.9 * RETRY))
    assert run(choice, 0.02, 20, 1.1 * RETRY) == [True] * 20                # something else is no longer running
    assert all(run(choice, 0.02, 100, 2 * RETRY))


def test_one_slow_image_changes_nothing() -> None:
    choice = CodingChoice()
    run(choice, 0.02, 10, 0.0)
    choice.took(3.0)
    assert all(run(choice, 0.02, 10, 1.0))


@pytest.mark.parametrize('link, longest', [
    (conditions(loss=0.05), 0.1),
    (conditions(room=SLOW), 0.2),                               # a raw image takes 0.2 s there
    (conditions(raw=float('inf'), room=float('inf')), 10.0),    # raw images are never whole
])
def test_layered_coding_is_not_too_slow_while_interleaving_shows_fewer_whole_images(link: Conditions, longest: float
                                                                                     ) -> None:
    assert all(run(CodingChoice(), 0.9 * longest, 20, 0.0, link))
    if longest < 1:
        assert not all(run(CodingChoice(), 1.1 * longest, 20, 0.0, link))


def test_raw_pixels_that_fit_but_take_long_are_tried_and_given_up() -> None:
    choice, slow = CodingChoice(), conditions(raw=0.9 * FITS * FAST)
    chosen = [choice.update(slow, 0.1 * step) for step in range(600)]
    tried = int(TRIAL / 0.1)
    assert not any(chosen[:tried]) and all(chosen[tried + 1:])
    again = TRIAL + TRIAL_INTERVAL + 0.2
    assert [choice.update(slow, again + second) for second in (0.0, HOLD, HOLD + 0.1, HOLD + 0.2 + TRIAL)] == [
        True, False, False, True]


def test_a_trial_that_finds_a_wide_link_goes_on() -> None:
    choice = CodingChoice()
    assert not choice.update(conditions(raw=0.9 * FITS * FAST), 0.0)
    assert not any(choice.update(conditions(raw=0.9 * FITS * FAST, room=10 * FAST), 0.1 * step)
                   for step in range(1, 600))


def test_it_explores_a_link_that_loses_nothing_for_a_while() -> None:
    choice, explored = CodingChoice(), []
    for step in range(1200):
        choice.update(conditions(room=SLOW), 0.1 * step)
        explored.append(choice.exploring)
    most = round(EXPLORATION / 0.1) + 1
    assert all(explored[:most - 2]) and sum(explored) <= 2 * most and any(explored[most:])
    for other in (conditions(room=SLOW, loss=0.2), conditions(room=SLOW, loss=None), conditions(room=10 * FAST)):
        choice = CodingChoice()
        choice.update(other, 0.0)
        assert not choice.exploring
