# SPDX-License-Identifier: BSD-3-Clause
from typing import List

import pytest

from smokebot_udp.monitoring.clock_client import MAX_QUESTIONS, STEADY, EchoClient

EPOCH = 1_700_000_000
SECOND = 10 ** 9


def answer(client: EchoClient, asked: int, now: float = 0.03) -> bool:
    """Answer a question by a clock that is 5 s ahead, after 10 ms on the link each way and 10 ms of work."""
    seconds = asked / SECOND
    return client.answer(asked, seconds + 5.01, seconds + 5.02, seconds + 0.03, now)


def test_an_answer_gives_an_estimate() -> None:
    client = EchoClient()
    assert client.estimate(0.0) is None
    client.ask(EPOCH * SECOND, 0.0)
    assert answer(client, EPOCH * SECOND)
    estimate = client.estimate(0.03)
    assert estimate is not None and estimate.offset == pytest.approx(5.0, abs=1e-6)
    assert estimate.round_trip == pytest.approx(0.02, abs=1e-6) and estimate.uncertainty >= 0.01 - 1e-6
    assert client.counts == {'jumps': 0}


def test_a_question_is_answered_once() -> None:
    client = EchoClient()
    client.ask(EPOCH * SECOND, 0.0)
    assert answer(client, EPOCH * SECOND) and not answer(client, EPOCH * SECOND)
    assert not answer(client, EPOCH * SECOND + 1)   # another operator's question
    assert client.counts == {'jumps': 0, 'refused, unasked': 2}


def test_questions_are_rare_while_the_clocks_agree() -> None:
    client, asked, step = EchoClient(), [], 5.0

    def run(start: int, stop: int) -> List[int]:
        """The seconds in which a question is sent."""
        asked.clear()
        for second in range(start, stop):
            if client.due(float(second)):
                now = EPOCH + second
                client.ask(now * SECOND, float(second))
                client.answer(now * SECOND, now + step + 0.01, now + step + 0.02, now + 0.03, second + 0.03)
                asked.append(second)
        return list(asked)

    assert run(0, STEADY) == list(range(STEADY))
    assert run(STEADY, 35) == list(range(STEADY + 3, 35, 4))
    step = 7.0      # the robot's clock is set: it is known a few seconds later
    assert run(35, 40) == [37, 38, 39]
    estimate = client.estimate(40.0)
    assert estimate is not None and estimate.offset == pytest.approx(7.0, abs=1e-6)
    assert run(40, 47) == list(range(40, 47))       # until it is steady again


def test_old_questions_are_closed() -> None:
    client = EchoClient()
    questions = [(EPOCH + second) * SECOND for second in range(MAX_QUESTIONS + 1)]
    for asked in questions:
        client.ask(asked, 0.0)
    assert not answer(client, questions[0]) and answer(client, questions[1])
