# SPDX-License-Identifier: BSD-3-Clause
"""Questions that several threads ask at once."""
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from polling import WAIT

from smokebot_udp.udpros import shared_answers
from smokebot_udp.udpros.shared_answers import MAX_KEYS, SharedAnswers


def test_threads_share_an_answer() -> None:
    asked = []

    def answer(key) -> int:
        asked.append(key)
        time.sleep(0.2)     # the others ask meanwhile
        return len(asked)

    shared = SharedAnswers(answer, 0.0)
    with ThreadPoolExecutor(16) as pool:
        answers = list(pool.map(lambda _: shared.ask('key', max_age=5.0), range(16)))
    assert asked == ['key'] and answers == 16 * [1]


def test_an_answer_is_not_older_than_wanted() -> None:
    counts = iter(range(10))
    shared = SharedAnswers(lambda _: next(counts), 0.0)
    assert (shared.ask('a'), shared.ask('a', 60.0), shared.ask('a'), shared.ask('b', 60.0)) == (0, 0, 1, 2)


def test_a_question_is_asked_once_a_period() -> None:
    times, began = [], time.monotonic()
    shared = SharedAnswers(lambda _: times.append(time.monotonic()), 0.2)
    with ThreadPoolExecutor(8) as pool:
        for _ in range(3):
            list(pool.map(lambda _: shared.ask('key'), range(8)))
    assert len(times) < 24      # those that ask at once share it
    # not from one to the next: a thread may have to wait between the question and its note
    assert all(at >= began + 0.2 * number for number, at in enumerate(times))


def test_an_error_is_shared_and_the_next_question_asked() -> None:
    answers = [OSError('once'), 7]

    def answer(_) -> int:
        one = answers.pop(0)
        if isinstance(one, Exception):
            raise one
        return one

    shared = SharedAnswers(answer, 0.0)
    for _ in range(2):
        with pytest.raises(OSError, match='once'):
            shared.ask('key', 60.0)
    assert shared.ask('key') == 7


def test_a_slow_answer_delays_only_those_who_need_it() -> None:
    leave = threading.Event()
    shared = SharedAnswers(lambda key: key == 'fast' or leave.wait(WAIT), 0.0)
    slow = threading.Thread(target=shared.ask, args=('slow',))
    slow.start()
    assert shared.ask('fast')
    leave.set()
    slow.join(WAIT)
    assert not slow.is_alive()


def test_answers_are_forgotten() -> None:
    asked = []
    shared = SharedAnswers(asked.append, 0.0)
    for key in range(2 * MAX_KEYS):
        shared.ask(key)
    shared.ask(0, 60.0)
    shared.ask(2 * MAX_KEYS - 1, 60.0)
    assert len(asked) == 2 * MAX_KEYS + 1


def test_an_answer_that_took_long_is_used_all_the_same(monkeypatch) -> None:
    """Questions that come one after the other share it, too."""
    asked, now = [], 100.0
    monkeypatch.setattr(shared_answers, 'time', SimpleNamespace(monotonic=lambda: now))

    def answer(key: str) -> int:
        nonlocal now
        asked.append(key)
        now += 1.1      # longer than it may be old
        if key == 'silent':
            raise OSError('no answer')
        return len(asked)

    shared = SharedAnswers(answer, 0.0)
    assert [shared.ask('slow', max_age=1.0) for _ in range(5)] == 5 * [1]
    for _ in range(5):
        with pytest.raises(OSError, match='no answer'):
            shared.ask('silent', max_age=1.0)
    assert asked == ['slow', 'silent'] and shared.ask('slow') == 3
