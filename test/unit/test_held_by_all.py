# SPDX-License-Identifier: BSD-3-Clause
"""Which images all operators hold, by reports that come late, get lost or lie."""
from smokebot_udp.streams.held import END, Holding
from smokebot_udp.streams.image.held_by_all import REFRESH, TIMEOUT, HeldByAll

KEPT = range(20)
ONE, BOTH = ('/one',), ('/one', '/two')


def holding(*layers: int, first: int = 0, session: int = 7) -> Holding:
    """A report that these numbers of layers of successive images are held."""
    return Holding.of_layers(session, {first + number: count for number, count in enumerate(layers) if count})


def test_nobody_holds_anything_before_a_report() -> None:
    held = HeldByAll()
    assert held.layers((), 7, KEPT, 0.0) == {} and held.layers(ONE, 7, KEPT, 0.0) == {}


def test_an_image_is_held_with_the_fewest_layers_of_all_who_get_the_stream() -> None:
    held = HeldByAll()
    held.held('/one', holding(3, 5, 4, 2))
    held.held('/two', holding(1, 0, 6, 2, 9))
    held.held('/gone', holding(0))
    assert held.layers(BOTH, 7, KEPT, 0.0) == {0: 1, 2: 4, 3: 2}
    assert held.layers(('/two',), 7, KEPT, 0.0) == {0: 1, 2: 6, 3: 2, 4: 9}


def test_the_last_report_counts_and_that_of_another_session_holds_nothing() -> None:
    held = HeldByAll()
    held.held('/one', holding(3, 5))
    held.held('/one', holding(4, first=1))
    assert held.layers(ONE, 7, KEPT, 0.0) == {1: 4}
    assert held.layers(ONE, 8, KEPT, 0.0) == {}
    held.held('/one', Holding.of(7, [1]))       # without layers, as video is reported
    assert held.layers(ONE, 7, KEPT, 0.0) == {}


def test_a_report_of_images_that_were_never_sent_takes_no_time() -> None:
    held = HeldByAll()
    held.held('/one', Holding(7, tuple((start, 65535) for start in range(0, END - 65535, END // 256)), 256 * (3,)))
    assert held.layers(ONE, 7, KEPT, 0.0) == {number: 3 for number in KEPT}


def test_a_newcomer_holds_nothing_and_who_left_and_comes_back_is_one() -> None:
    held = HeldByAll()
    held.held('/one', holding(3))
    held.held('/two', holding(3))
    assert held.layers(BOTH, 7, KEPT, 0.0) == {0: 3}
    assert held.layers(ONE, 7, KEPT, 0.1) == {0: 3}
    assert held.layers(BOTH, 7, KEPT, 0.2) == {}


def test_who_does_not_answer_is_left_out_but_one_image_a_second_needs_no_reference() -> None:
    held, without = HeldByAll(), []
    for number in range(60):
        now = number / 10
        held.held('/one', holding(2, first=number))
        found = held.layers(BOTH, 7, range(number + 1), now)
        assert found in ({}, {number: 2})
        held.sent(BOTH, bool(found), now)
        without += [] if found else [number]
    silent = int(10 * TIMEOUT)
    assert without[:silent + 1] == list(range(silent + 1))
    assert {later - earlier for earlier, later in zip(without[silent:], without[silent + 1:])} == {10 * REFRESH}
    held.held('/two', holding(1, first=59))
    assert held.layers(BOTH, 7, range(60), 6.0) == {59: 1}


def test_who_was_sent_nothing_need_not_answer() -> None:
    held = HeldByAll()
    held.held('/one', holding(2))
    assert held.layers(ONE, 7, KEPT, 100.0) == {0: 2}
    held.sent(ONE, True, 100.0)
    assert held.layers(ONE, 7, KEPT, 100.0 + TIMEOUT) == {0: 2}
    assert held.layers(ONE, 7, KEPT, 100.1 + TIMEOUT) == {}
