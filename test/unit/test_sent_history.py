# SPDX-License-Identifier: BSD-3-Clause
from smokebot_udp.congestion.sent_history import MAX_AGE, MAX_BURSTS, MIN_BURSTS, TOGETHER, SentHistory, stream_of


def test_a_datagram_is_found_with_the_total_sent_by_then() -> None:
    history = SentHistory()
    history.add('thermal', 1, 3, 1000, 10.0)
    history.add('tf', 7, 1, 200, 10.1)
    history.add('thermal', 4, 2, 500, 10.2)
    assert history.find('thermal', 1) == (10.0, 1000, 1000, 1000)
    assert history.find('thermal', 3) == (10.0, 1000, 3000, 3000)
    assert history.find('tf', 7) == (10.1, 200, 3200, 200)
    assert history.find('thermal', 5) == (10.2, 500, 4200, 1000)
    assert history.total == 4200
    assert history.totals('thermal') == (5, 4000)


def test_the_parts_of_a_stream_are_numbered_by_themselves_and_add_up() -> None:
    history = SentHistory()
    history.add('thermal', 1, 3, 1000, 10.0)
    history.add('thermal/layers', 1, 2, 700, 10.1)
    history.add('thermal2', 1, 1, 99, 10.1)
    assert history.find('thermal/layers', 1) == (10.1, 700, 3700, 700) and history.totals('thermal') == (3, 3000)
    assert history.bytes_of('thermal') == 4400 and history.bytes_of('thermal2') == 99 and history.bytes_of('tf') == 0
    assert [stream_of(name) for name in ('thermal', 'thermal/layers')] == ['thermal', 'thermal']


def test_what_is_sent_within_a_moment_is_sent_together() -> None:
    history = SentHistory()
    history.add('tf', 1, 1, 200, 1.0)
    history.add('thermal', 1, 3, 1000, 1.0 + 0.9 * TOGETHER)
    history.add_besides(50)
    history.add('tf', 2, 1, 200, 1.0 + 1.1 * TOGETHER)
    assert [history.find('thermal', seq).together for seq in (1, 3)] == [1200, 3200]
    assert history.find('tf', 2).together == 200


def test_a_datagram_that_was_never_sent_is_not_found() -> None:
    history = SentHistory()
    history.add('thermal', 5, 3, 1000, 10.0)
    assert history.find('thermal', 4) is None
    assert history.find('thermal', 8) is None
    assert history.find('camera', 5) is None
    assert history.totals('camera') == (0, 0)


def test_a_gap_in_the_sequence_numbers_holds_nothing() -> None:
    history = SentHistory()
    history.add('thermal', 1, 2, 1000, 10.0)
    history.add('thermal', 9, 1, 1000, 10.0)
    assert history.find('thermal', 5) is None


def test_sequence_numbers_wrap() -> None:
    history = SentHistory()
    history.add('thermal', 2 ** 32 - 1, 3, 10, 1.0)
    assert history.find('thermal', 2 ** 32 - 1).total == 10
    assert history.find('thermal', 0).total == 20
    assert history.find('thermal', 1).total == 30
    assert history.find('thermal', 2) is None


def test_a_numbering_that_starts_again_replaces_the_old_one() -> None:
    history = SentHistory()
    history.add('thermal', 100, 5, 10, 1.0)
    history.add('thermal', 1, 2, 10, 2.0)
    assert history.find('thermal', 2) == (2.0, 10, 70, 20)
    assert history.find('thermal', 102) is None


def test_memory_is_bounded() -> None:
    history = SentHistory()
    for k in range(5 * MAX_BURSTS):
        history.add('thermal', k + 1, 1, 10, 1e-3 * k)
    assert history.find('thermal', 1) is None
    assert history.find('thermal', 4 * MAX_BURSTS + 1).total == 10 * (4 * MAX_BURSTS + 1)
    assert history.totals('thermal') == (5 * MAX_BURSTS, 50 * MAX_BURSTS)


def test_old_bursts_are_forgotten_but_for_the_last_ones() -> None:
    history = SentHistory()
    for k in range(2000):       # 200 s
        history.add('thermal', k + 1, 1, 10, 0.1 * k)
    for k in range(4 * MIN_BURSTS):
        history.add('map', k + 1, 1, 10, MAX_AGE * k)
    assert history.find('thermal', 2000 - int(10 * MAX_AGE)) is not None
    assert history.find('thermal', 2000 - 2 * int(10 * MAX_AGE) - 1) is None
    assert history.find('map', 3 * MIN_BURSTS + 1) is not None
    assert history.find('map', 2 * MIN_BURSTS) is None
    assert history.totals('thermal') == (2000, 20000)


def test_what_no_report_names_is_between_the_datagrams_of_streams() -> None:
    """A rate is measured by all bytes that the path carried between two samples."""
    history = SentHistory()
    history.add('image', 1, 1, 100, 0.0)
    history.add_besides(50)
    history.add('image', 2, 1, 100, 0.1)
    found = history.find('image', 2)
    assert found is not None and found.total == history.total == 250
    assert history.totals('image') == (2, 200)
