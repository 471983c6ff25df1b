# SPDX-License-Identifier: BSD-3-Clause
"""A dictionary of bounded size."""
from typing import List

from smokebot_udp.budget import Budget
from smokebot_udp.newest import Newest


def test_what_was_set_longest_ago_is_forgotten() -> None:
    newest: Newest[str, int] = Newest(3)
    for number, name in enumerate('abcad'):
        newest[name] = number
    assert list(newest.items()) == [('c', 2), ('a', 3), ('d', 4)]


def test_a_value_is_made_once_and_kept_while_it_is_wanted() -> None:
    newest: Newest[str, List[int]] = Newest(2)
    first = newest.of('first', list)
    for name in 'abc':
        assert newest.of(name, list) is not newest.of('first', list) is first
    assert list(newest) == ['c', 'first']


def test_one_host_does_not_take_the_others_share() -> None:
    budgets: Newest[int, Budget] = Newest(256)

    def take(host: int, now: float) -> bool:
        return budgets.of(host, lambda: Budget(3, 0.1)).take(now)
    assert [take(1, 5.0) for _ in range(4)] == [True] * 3 + [False]
    assert take(2, 5.0)
    assert take(1, 5.11) and not take(1, 5.12)
    for host in range(2000):
        take(host, 6.0)
    assert len(budgets) == 256
