# SPDX-License-Identifier: BSD-3-Clause
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.streams.stillness import Stillness


def every(step, begin, end):
    """Times from begin up to end, both included."""
    return [begin + step * i for i in range(int(round((end - begin) / step)) + 1)]


def test_it_stands_after_half_a_second():
    stillness = Stillness()
    for now in every(0.1, 10.0, 10.4):
        stillness.odometry(0.0, 0.0, now)
        assert not stillness.stands(now)
    stillness.odometry(0.0, 0.0, 10.51)
    assert stillness.stands(10.51)


@pytest.mark.parametrize('speed, turn_rate, stands', [
    (0.019, 0.0, True), (0.0, -0.019, True), (0.021, 0.0, False), (-0.021, 0.0, False), (0.0, -0.021, False),
    (math.nan, 0.0, False), (0.0, math.nan, False), (math.inf, 0.0, False)])
def test_slower_than_the_limits_is_standing(speed, turn_rate, stands):
    for tell in ('odometry', 'command'):
        stillness = Stillness()
        for now in every(0.1, 0.0, 1.0):
            getattr(stillness, tell)(speed, turn_rate, now)
        assert stillness.stands(1.0) is stands


def test_it_moves_at_once():
    stillness = Stillness()
    for now in every(0.1, 0.0, 2.0):
        stillness.odometry(0.0, 0.0, now)
    assert stillness.stands(2.0)
    stillness.odometry(0.1, 0.0, 2.05)
    assert not stillness.stands(2.05)
    stillness.odometry(0.0, 0.0, 2.1)
    assert not stillness.stands(2.1) and not stillness.stands(2.5) and stillness.stands(2.7)


def test_nothing_told_is_not_standing():
    stillness = Stillness()
    assert not stillness.stands(0.0) and stillness.source(0.0) is None
    stillness.pictures(None, 0.0)
    assert stillness.source(0.0) is None


def test_odometry_is_believed_before_commands_and_those_before_pictures():
    stillness = Stillness()
    for now in every(0.1, 0.0, 2.0):
        stillness.pictures(0.9, now)
        stillness.command(0.0, 0.0, now)
        stillness.odometry(0.5, 0.0, now)
    assert stillness.source(2.0) == 'odometry' and not stillness.stands(2.0)
    for now in every(0.1, 2.1, 3.2):
        stillness.pictures(0.9, now)
        stillness.command(0.0, 0.0, now)
    assert stillness.source(3.2) == 'command' and stillness.stands(3.2)
    for now in every(0.1, 3.3, 4.4):
        stillness.pictures(0.9, now)
    assert stillness.source(4.4) == 'pictures' and not stillness.stands(4.4)
    for now in every(0.1, 4.5, 5.2):
        stillness.pictures(0.01, now)
    assert stillness.stands(5.2)
    assert stillness.source(6.3) is None and not stillness.stands(6.3)


def test_what_it_did_while_silent_nobody_knows():
    stillness = Stillness()
    for now in every(0.1, 0.0, 1.0):
        stillness.odometry(0.0, 0.0, now)
    assert stillness.stands(1.9) and not stillness.stands(2.1)
    stillness.odometry(0.0, 0.0, 3.0)
    assert not stillness.stands(3.0) and stillness.stands(3.6)


def test_a_clock_set_back():
    stillness = Stillness()
    for now in every(0.1, 100.0, 101.0):
        stillness.odometry(0.0, 0.0, now)
    assert stillness.stands(101.0) and not stillness.stands(5.0)
    stillness.odometry(0.0, 0.0, 5.0)
    assert not stillness.stands(5.0) and stillness.stands(5.6)


@given(st.lists(st.tuples(st.sampled_from(['odometry', 'command', 'pictures']), st.booleans(), st.floats(0.01, 1.5)),
                max_size=40))
def test_as_reckoned_from_all_that_was_told(told):
    """Against the definition: the best source that spoke within `silence`, and all it said for `hold`."""
    stillness, now, said = Stillness(), 0.0, {'odometry': [], 'command': [], 'pictures': []}
    for source, still, later in told:
        now += later
        said[source].append((now, still))
        if source == 'pictures':
            stillness.pictures(0.0 if still else 1.0, now)
        else:
            getattr(stillness, source)(0.0 if still else 1.0, 0.0, now)
        assert stillness.stands(now) == reckoned(said, now)
        assert stillness.stands(now + 0.7) == reckoned(said, now + 0.7)


def reckoned(said, now):
    for source in ('odometry', 'command', 'pictures'):
        if said[source] and now - said[source][-1][0] <= 1.0:
            since, after = None, now
            for time, still in reversed(said[source]):
                if not still or after - time > 1.0:
                    break
                since = after = time
            return since is not None and now - since >= 0.5
    return False
