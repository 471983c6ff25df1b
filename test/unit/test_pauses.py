# SPDX-License-Identifier: BSD-3-Clause
"""How long a path may be silent, from the pauses that it made."""
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.pauses import MARGIN, MAX_PAUSES, MEMORY, Pauses


def test_a_path_that_is_heard_in_time_counts_as_cut_after_the_least_time() -> None:
    path = Pauses(0.1, 0.5, 0.0)
    for step in range(1, 50):
        assert not path.is_cut(0.09 * step)
        path.hear(0.09 * step, 0.09 * step)
    assert path.limit(5.0) == 0.1 and path.ends(4.5) == pytest.approx(0.09 * 49 + 0.1)
    assert path.is_cut(4.52)


def test_one_that_pauses_may_be_silent_for_longer_for_a_while() -> None:
    path = Pauses(0.1, 0.5, 0.0)
    for when in (0.2, 0.35, 0.4):       # pauses of 0.2, 0.15 and none
        path.hear(when, when)
    assert path.limit(0.4) == pytest.approx(MARGIN * 0.2)
    assert path.limit(0.2 + MEMORY) == pytest.approx(MARGIN * 0.15)
    assert path.limit(0.35 + MEMORY) == 0.1


def test_what_is_longer_than_the_most_is_no_pause_and_the_limit_is_no_longer() -> None:
    path = Pauses(0.1, 0.5, -math.inf)
    path.hear(1.0, 1.0)
    path.hear(1.6, 1.6)
    assert path.limit(1.6) == 0.1
    path.hear(2.1, 2.1)
    assert path.limit(2.1) == 0.5


def test_what_becomes_known_late_is_a_pause_until_then() -> None:
    """A report says what was sent before it left the other side."""
    path = Pauses(0.35, 1.0, 0.0)
    for step in range(1, 20):
        path.hear(0.1 * step, 0.1 * step + 0.4)
    assert path.heard == pytest.approx(1.9) and not path.is_cut(2.4)
    path.hear(1.0, 2.4)      # an older one
    assert path.heard == pytest.approx(1.9)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=3 * MAX_PAUSES))
def test_the_limit_is_that_of_the_longest_pause(lengths: list) -> None:     # type: ignore[type-arg]
    path, now, pauses = Pauses(0.1, 0.5, 0.0), 0.0, []
    for length in lengths:
        now += length
        pauses.append((now, now - path.heard))
        path.hear(now, now)
    longest = max((length for when, length in pauses if 0.1 < length <= 0.5 and now - when < MEMORY), default=0.0)
    assert path.limit(now) == pytest.approx(min(max(0.1, MARGIN * longest), 0.5))
