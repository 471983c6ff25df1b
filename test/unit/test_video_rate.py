# SPDX-License-Identifier: BSD-3-Clause
"""How an image's bytes are divided, and what a video encoder is opened for and asked for."""
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.video.protection import LENGTH_BYTES
from smokebot_udp.codecs.video.rate import (
    EACH,
    LEAST_AGE,
    LONG,
    SHORT,
    Opening,
    SizeControl,
    coding_error,
    intra_cost,
    plan,
    reopening,
)
from smokebot_udp.codecs.video.redundancy import (
    Link,
    Scene,
    Sizes,
    divide,
    division,
    expected_error,
    parities,
    slice_bytes,
)

SIZES = Sizes(room=1300, head=100)
SLOW = Scene(coding_error=5.0, change=9.0, refresh=LONG)
"""A slowly moving camera: later images suffer from a loss four times as much as the image itself."""

LOSSES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)


def test_the_expected_error_of_one_slice_by_hand() -> None:
    # one datagram, lost in a quarter of the cases; the image before is wrong in as many, and shows in this one
    scene = Scene(coding_error=2.0, change=6.0, refresh=2)      # damage 3, nothing remains wrong later
    assert expected_error(1, 0, 1.0, scene, Link({0.25: 1.0})) == pytest.approx(0.25 * math.log(1 + 3))
    # two copies at twice the cost: log 2, or log(2 + 3) in a sixteenth
    assert expected_error(1, 1, 2.0, scene, Link({0.25: 1.0})) == pytest.approx(
        15 / 16 * math.log(2) + 1 / 16 * math.log(5))


def test_what_was_lost_before_by_hand() -> None:
    # refresh 6, half of 6 images minus this one, halved because half of the next image is coded without reference
    scene = Scene(coding_error=300.0, change=300.0, refresh=6)
    assert scene.later == 1.0
    # usually 1/4 is lost, so 1/3 remains wrong
    assert expected_error(1, 0, 1.0, scene, Link({0.25: 1.0})) == pytest.approx(
        0.75 * math.log(4 / 3) + 0.25 * math.log(1 + 1 + 1 / 3))


def test_half_of_two_slices_lost_in_bursts() -> None:
    # runs of 2 at a loss of a half: as if independent. In longer runs as many images fail, but all of them is lost
    single, burst = (expected_error(2, 1, 1.5, SLOW, Link({0.5: 1.0}, burst)) for burst in (None, 2.0))
    assert burst == pytest.approx(single)
    assert expected_error(2, 1, 1.5, SLOW, Link({0.5: 1.0}, 8.0)) > single + 0.1


@pytest.mark.parametrize('budget', [4000, 12500, 37500, 200000])
def test_parity_grows_with_the_loss_and_all_fits_the_budget(budget) -> None:
    last = 0.0
    for loss in LOSSES:
        found = divide(budget, SIZES, SLOW, Link({loss: 1.0}))
        piece = min(found.size, SIZES.room) + LENGTH_BYTES + SIZES.head
        slices = max(found.size / SIZES.room, 1.0)
        assert found.size + slices * SIZES.head + found.parities * piece == pytest.approx(budget, rel=0.01)
        share = found.parities * piece / budget
        assert share >= last - 0.05
        last = max(share, last)
    assert divide(budget, SIZES, SLOW, Link({0.0: 1.0})).parities == 0
    assert last > 0.5


def test_the_parity_of_an_only_slice_is_as_short_as_the_slice() -> None:
    # 3740 byte on the air hold one full datagram of parity; or four of 935, a slice and three parity pieces
    found = division(3740, 3, SIZES, SLOW, Link({0.5: 1.0}))
    assert divide(3740, SIZES, SLOW, Link({0.5: 1.0})).parities == 2
    assert found.size == (3740 - 3 * LENGTH_BYTES) // 4 - SIZES.head


def test_where_two_slices_become_one() -> None:
    # with one parity piece: at 2 * 1400 byte and what tells its length, one slice fills its datagram
    both = 2 * (SIZES.room + SIZES.head) + LENGTH_BYTES
    shorter, longer = (slice_bytes(both + change, 1, SIZES) for change in (-28, 28))
    assert shorter == SIZES.room - 14
    assert longer == pytest.approx(SIZES.room + 28 * SIZES.room / (SIZES.room + SIZES.head))


@given(st.integers(3000, 200000), st.sampled_from(LOSSES), st.sampled_from([None, 2.0, 5.0]), st.floats(0.1, 50),
       st.floats(0, 4000))
@settings(max_examples=60, deadline=None)
def test_no_other_number_of_parities_is_clearly_better(budget, loss, burst, error, change) -> None:
    scene, link = Scene(error, change, LONG), Link({loss: 0.9, 0.6: 0.1}, burst)
    found = divide(budget, SIZES, scene, link)
    assert found.size > 0.2 * budget * SIZES.room / 1400 and found.parities <= 255
    others = [division(budget, number, SIZES, scene, link).error for number in range(int(0.7 * budget / SIZES.parity))]
    assert found.error <= min(others, default=math.inf) + 0.1


def test_the_usual_division_is_kept_unless_another_one_is_clearly_better() -> None:
    kept = [divide(12500, SIZES, SLOW, Link({0.1: 1.0}), usual).parities for usual in range(6)]
    best = divide(12500, SIZES, SLOW, Link({0.1: 1.0})).parities
    assert kept[best] == best and kept[best + 1] == best + 1 and kept[0] == best


def test_parities_of_an_image_are_those_that_there_is_room_for() -> None:
    link, lengths = Link({0.3: 1.0}), [1300] * 8
    free = parities(lengths, 100, SIZES, SLOW, link)
    assert 4 <= free <= 12
    assert parities(lengths, 2, SIZES, SLOW, link) == 2
    assert parities(lengths, 0, SIZES, SLOW, link) == parities(lengths, -3, SIZES, SLOW, link) == 0
    assert parities(lengths, 100, SIZES, SLOW, Link({0.0: 1.0})) == 0


def test_the_code_holds_no_more_pieces() -> None:
    assert parities([1300] * 250, 100, SIZES, SLOW, Link({0.5: 1.0})) <= 5


def test_a_short_refresh_cycle_where_losses_remain() -> None:
    mild, lossy = Link({0.0: 1.0}), Link({0.3: 1.0}, 8.0)
    for usual in (LONG, SHORT):
        assert plan(3750, SIZES, Scene(5.0, 100.0, usual), mild).refresh == LONG
    assert plan(3750, SIZES, Scene(5.0, 100.0, SHORT), lossy).refresh == SHORT
    assert plan(3750, SIZES, Scene(5.0, 100.0, LONG), lossy).refresh == SHORT


def test_what_another_refresh_cycle_gains() -> None:
    mild, lossy = Link({0.0: 1.0}), Link({0.3: 1.0}, 8.0)
    scene = Scene(5.0, 100.0, LONG)
    assert plan(3750, SIZES, scene, mild).gain < 0 < plan(3750, SIZES, scene, lossy).gain


def test_another_refresh_cycle_must_prove_itself_only_in_bursts_where_images_are_predicted() -> None:
    scene, bursts = Scene(5.0, 100.0, LONG), Link({0.3: 1.0}, 8.0)
    assert not plan(3750, SIZES, scene._replace(intra_cost=1.2), bursts).at_once
    assert plan(3750, SIZES, scene._replace(intra_cost=0.9), bursts).at_once
    assert plan(3750, SIZES, scene, Link({0.3: 1.0})).at_once


def test_nothing_is_predicted_where_each_image_shows_another_view() -> None:
    clean, lossy = Link({0.0: 1.0}), Link({0.2: 1.0})
    for link in (clean, lossy):
        assert plan(3750, SIZES, Scene(10.0, 3500.0, LONG, intra_cost(0.9)), link).refresh == EACH
        assert plan(3750, SIZES, Scene(10.0, 3500.0, EACH, intra_cost(0.9)), link).refresh == EACH
        assert plan(3750, SIZES, Scene(10.0, 5.0, EACH, intra_cost(0.001)), link).refresh != EACH
    assert intra_cost(0.0) == pytest.approx(4.0) == intra_cost(None)
    assert intra_cost(3.0) == pytest.approx(0.8)
    assert 0.8 < intra_cost(0.1) < 4.0


def test_the_encoder_is_opened_for_the_whole_image() -> None:
    found = plan(14000, SIZES, SLOW, Link({0.3: 1.0}))
    assert found.size == 13000 and found.division.size < 10000


@pytest.mark.parametrize('opened, age, size, refresh, anew', [
    (None, 0, 1000, 10, True),
    (Opening(1000, 10), 100, 1000, 10, False),
    (Opening(1000, 10), 100, 1200, 10, False),
    (Opening(1000, 10), 100, 1250, 10, True),
    (Opening(1000, 10), LEAST_AGE - 1, 1250, 10, False),
    (Opening(1000, 10), 100, 340, 10, False),
    (Opening(1000, 10), 0, 330, 10, True),
    (Opening(1000, 10), LEAST_AGE, 1000, 5, True),
    (Opening(1000, 10), LEAST_AGE - 1, 1000, 5, False),
])
def test_when_an_encoder_is_opened_anew(opened, age, size, refresh, anew) -> None:
    expected = Opening(int(1.15 * size), refresh) if anew else None
    assert reopening(opened, age, size, refresh) == expected


@pytest.mark.parametrize('used', [0.8, 0.9, 1.2])
def test_images_become_as_large_as_wanted(used) -> None:
    control, on_air = SizeControl(), 0.0
    for _ in range(60):
        on_air = 1.1 * used * control.asked(9000)
        control.add(1.1 * 9000, on_air)
    assert on_air == pytest.approx(1.1 * 9000, rel=0.01)


def test_no_more_is_asked_for_however_little_a_still_scene_takes() -> None:
    control = SizeControl()
    for _ in range(100):
        control.add(10000, 50)
    assert control.asked(1000) == 1400


def test_the_coding_error_doubles_in_six_steps() -> None:
    assert coding_error(24) == 2 * coding_error(18) == 4.0
