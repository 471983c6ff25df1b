# SPDX-License-Identifier: BSD-3-Clause
from smokebot_udp.congestion.sent_history import KEPT, Departures


def test_a_datagram_is_found_with_what_had_left_by_then():
    departures = Departures()
    departures.note('thermal', 1, 3, 1000, 10.0)
    departures.note('tf', 7, 1, 200, 10.1)
    departures.note_unnumbered(50)
    departures.note('thermal', 4, 2, 500, 10.2)
    assert departures.find('thermal', 1) == (10.0, 1000, 1000)
    assert departures.find('thermal', 3) == (10.0, 1000, 3000)
    assert departures.find('tf', 7) == (10.1, 200, 3200)
    assert departures.find('thermal', 5) == (10.2, 500, 4250)
    assert departures.total == 4250
    assert departures.sent('thermal') == (5, 4000)


def test_what_never_left_is_not_found():
    departures = Departures()
    departures.note('thermal', 5, 3, 1000, 10.0)
    assert departures.find('thermal', 4) is None
    assert departures.find('thermal', 8) is None
    assert departures.find('camera', 5) is None
    assert departures.sent('camera') == (0, 0)


def test_a_gap_in_the_numbers_holds_nothing():
    departures = Departures()
    departures.note('thermal', 1, 2, 1000, 10.0)
    departures.note('thermal', 9, 1, 1000, 10.0)
    assert departures.find('thermal', 5) is None


def test_numbers_wrap_on_the_way():
    departures = Departures()
    departures.note('thermal', 2 ** 32 - 1, 3, 10, 1.0)
    assert departures.find('thermal', 2 ** 32 - 1).total == 10
    assert departures.find('thermal', 0).total == 20
    assert departures.find('thermal', 1).total == 30
    assert departures.find('thermal', 2) is None


def test_a_numbering_that_begins_anew_forgets_the_old_one():
    departures = Departures()
    departures.note('thermal', 100, 5, 10, 1.0)
    departures.note('thermal', 1, 2, 10, 2.0)
    assert departures.find('thermal', 2) == (2.0, 10, 70)
    assert departures.find('thermal', 102) is None


def test_memory_is_bounded():
    departures = Departures()
    for k in range(5 * KEPT):
        departures.note('thermal', k + 1, 1, 10, float(k))
    assert departures.find('thermal', 1) is None
    assert departures.find('thermal', 4 * KEPT + 1).total == 10 * (4 * KEPT + 1)
    assert departures.sent('thermal') == (5 * KEPT, 50 * KEPT)
