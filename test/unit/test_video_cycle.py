# SPDX-License-Identifier: BSD-3-Clause
"""When video changes its refresh cycle."""
from smokebot_udp.codecs.video import rate
from smokebot_udp.codecs.video.redundancy import Division

SIZE = 3000


def plan(refresh: int, gain: float, at_once: bool = False, size: int = SIZE) -> rate.Plan:
    return rate.Plan(Division(SIZE, 0, 0.0), size, refresh, gain, at_once)


def grown_up() -> rate.Openings:
    """Those of a session whose encoder is old enough to be replaced."""
    openings = rate.Openings()
    opened = [openings.renew(plan(rate.LONG, -0.5)) for _ in range(rate.LEAST_AGE)]
    assert opened == [True] + [False] * (rate.LEAST_AGE - 1)
    return openings


def test_a_burst_of_losses_changes_nothing() -> None:
    openings = grown_up()
    for gain in 20 * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]:
        assert not openings.renew(plan(rate.SHORT if gain > 0 else rate.LONG, gain))
    assert openings.refresh == rate.LONG


def test_losses_that_remain_do() -> None:
    openings, images = grown_up(), 1
    while not openings.renew(plan(rate.SHORT, 0.5)):
        images += 1
    assert images == int(rate.REPAID / 0.5) + 1
    assert openings.refresh == rate.SHORT and openings.age == 0


def test_what_was_missed_is_repaid_once() -> None:
    openings = grown_up()
    for cycle in (rate.SHORT, rate.LONG):
        images = 1
        while not openings.renew(plan(cycle, 0.25)):
            images += 1
        assert openings.refresh == cycle and images == int(rate.REPAID / 0.25) + 1


def test_what_needs_no_proof_changes_it_at_once() -> None:
    openings = grown_up()
    assert openings.renew(plan(rate.EACH, 0.5, at_once=True)) and openings.refresh == rate.EACH


def test_an_encoder_that_is_opened_for_its_size_has_the_best_cycle() -> None:
    openings = grown_up()
    assert openings.renew(plan(rate.SHORT, 0.5, size=2 * SIZE))
    assert openings.opening == rate.Opening(int(rate.HEADROOM * 2 * SIZE), rate.SHORT)
