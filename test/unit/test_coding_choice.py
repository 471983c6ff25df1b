# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, List

import pytest

from smokebot_udp.streams.image.coding_choice import ENOUGH, HOLD, MEASURED, QUICK, RETRY, CodingChoice, Conditions

FAST, SLOW = 1e7, 1e6       # links [byte/s]


def conditions(raw: float = 2e5, room: float = FAST, loss: Any = 0.0, period: float = 0.1) -> Conditions:
    return Conditions(raw, room, loss, period)


@pytest.mark.parametrize('now, layered', [
    (conditions(), False),
    (conditions(room=float('inf')), False),
    (conditions(raw=float('inf'), room=float('inf')), True),    # they may not be so large
    (conditions(room=SLOW), True),                  # raw pixels do not fit
    (conditions(raw=0.025 * FAST), True),           # they do, but take longer than coding
    (conditions(raw=0.015 * FAST, period=0.02), True),      # they do, without time to spare
    (conditions(loss=0.05), True),
    (conditions(loss=None), True),                  # plan for the worst
])
def test_the_first_image_is_coded_as_its_link_is(now: Conditions, layered: bool) -> None:
    assert CodingChoice().update(now, 5.0) is layered


def test_images_stay_layered_while_other_streams_take_all_of_the_link() -> None:
    assert all(run(CodingChoice(), 0.5, 2 * MEASURED, 0.0, conditions(room=0.0)))


def test_a_link_that_gets_worse_counts_at_once_and_one_that_gets_better_after_a_while() -> None:
    choice = CodingChoice()
    assert not choice.update(conditions(), 0.0)
    assert choice.update(conditions(room=SLOW), 0.1)
    assert choice.update(conditions(), 0.2) and choice.update(conditions(), 0.1 + HOLD)
    assert choice.update(conditions(loss=0.2), 0.15 + HOLD)     # the time begins anew
    assert choice.update(conditions(), 0.2 + HOLD) and choice.update(conditions(), 0.1 + 2 * HOLD)
    assert not choice.update(conditions(), 0.2 + 2 * HOLD)


def test_neither_loss_nor_bandwidth_near_the_limit_changes_it_to_and_fro() -> None:
    choice, chosen = CodingChoice(), []
    for step in range(300):
        near = conditions(raw=(QUICK + 0.005 * (step % 2)) * FAST, loss=0.005 + 0.015 * (step % 3 == 0))
        chosen.append(choice.update(near, 0.1 * step))
    assert len([1 for before, after in zip(chosen, chosen[1:]) if before != after]) <= 1


LOSSY = conditions(loss=0.05)


def run(choice: CodingChoice, duration: float, images: int, start: float, link: Conditions = LOSSY,
        error: float = 0.0) -> List[bool]:
    """Layered images that take so long, ten a second [s]."""
    chosen = []
    for number in range(images):
        chosen.append(choice.update(link, start + 0.1 * number))
        if chosen[-1]:
            choice.took(duration, error)
    return chosen


LOOKED_AT = conditions()._replace(looked_at=True)
"""Raw pixels fit well."""


def test_images_to_look_at_stay_layered_as_long_as_that_shows_them_well_enough() -> None:
    choice = CodingChoice()
    assert all(run(choice, 0.01, 100, 0.0, LOOKED_AT, 0.99 * ENOUGH))
    assert not choice.is_possible(LOOKED_AT, 10.0)                      # so that the link is not probed for raw pixels
    assert not any(run(CodingChoice(), 0.01, 100, 0.0, conditions(), 0.99 * ENOUGH))    # measurements are exact


def test_images_to_look_at_whose_layers_are_coarse_are_raw_and_tried_again_later() -> None:
    choice = CodingChoice()
    chosen = run(choice, 0.01, 100, 0.0, LOOKED_AT, 1.01 * ENOUGH)
    raw_from = chosen.index(False)
    assert raw_from >= MEASURED + HOLD / 0.1 and not any(chosen[raw_from:])
    assert choice.is_possible(LOOKED_AT, 10.0)
    assert all(run(choice, 0.01, 100, 10.0 + RETRY, LOOKED_AT, 0.0))    # another scene


def test_where_raw_pixels_do_not_fit_coarse_layers_remain() -> None:
    assert all(run(CodingChoice(), 0.01, 100, 0.0, LOOKED_AT._replace(room=SLOW), 10 * ENOUGH))


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
