# SPDX-License-Identifier: BSD-3-Clause
from types import SimpleNamespace
from typing import Any

from smokebot_udp.nodes.problems import RECENT, REMEMBERED, Problems


def test_without_a_problem_all_is_fine() -> None:
    assert Problems().status(0.0) == ('settings', 'settings', 0, 'fine', {'problems': 0}, '', '')


def test_the_last_problems_are_told_and_warned_of_for_a_while(monkeypatch: Any) -> None:
    now = 100.0
    monkeypatch.setattr('smokebot_udp.nodes.problems.time', SimpleNamespace(monotonic=lambda: now))
    problems = Problems()
    for number in range(REMEMBERED + 2):
        problems.report('rate is -%d' % number)
    _, _, level, message, values, *_ = problems.status(now)
    assert (level, message, values['problems']) == (1, 'rate is -6', REMEMBERED + 2)
    assert list(values)[1:] == ['problem 7', 'problem 6', 'problem 5', 'problem 4', 'problem 3']
    assert values['problem 7'] == 'rate is -6 (0 s ago)'
    _, _, level, message, values, *_ = problems.status(now + RECENT)
    assert (level, message) == (0, 'fine') and values['problem 7'] == 'rate is -6 (60 s ago)'
