# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any, Dict, List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.streams.standstill import StandstillDetector


def every(step: float, begin: float, end: float) -> List[float]:
    """Times from begin up to end, both included."""
    return [begin + step * i for i in range(int(round((end - begin) / step)) + 1)]


def test_it_stands_after_half_a_second() -> None:
    detector = StandstillDetector()
    for now in every(0.1, 10.0, 10.4):
        detector.velocity('odometry', 0.0, 0.0, now)
        assert not detector.is_still(now)
    detector.velocity('odometry', 0.0, 0.0, 10.51)
    assert detector.is_still(10.51)


@pytest.mark.parametrize('speed, turn_rate, stands', [
    (0.019, 0.0, True), (0.0, -0.019, True), (0.021, 0.0, False), (-0.021, 0.0, False), (0.0, -0.021, False),
    (math.nan, 0.0, False), (0.0, math.nan, False), (math.inf, 0.0, False)])
def test_slower_than_the_limits_is_standing(speed: float, turn_rate: float, stands: bool) -> None:
    for tell in ('odometry', 'command'):
        detector = StandstillDetector()
        for now in every(0.1, 0.0, 1.0):
            detector.velocity(tell, speed, turn_rate, now)
        assert detector.is_still(1.0) is stands


def test_it_moves_at_once() -> None:
    detector = StandstillDetector()
    for now in every(0.1, 0.0, 2.0):
        detector.velocity('odometry', 0.0, 0.0, now)
    assert detector.is_still(2.0)
    detector.velocity('odometry', 0.1, 0.0, 2.05)
    assert not detector.is_still(2.05)
    detector.velocity('odometry', 0.0, 0.0, 2.1)
    assert not detector.is_still(2.1) and not detector.is_still(2.5) and detector.is_still(2.7)


def test_nothing_told_is_not_standing() -> None:
    detector = StandstillDetector()
    assert not detector.is_still(0.0) and detector.source(0.0) is None
    detector.images(None, 0.0)
    assert detector.source(0.0) is None


def test_odometry_is_believed_before_commands_and_those_before_pictures() -> None:
    detector = StandstillDetector()
    for now in every(0.1, 0.0, 2.0):
        detector.images(0.9, now)
        detector.velocity('command', 0.0, 0.0, now)
        detector.velocity('odometry', 0.5, 0.0, now)
    assert detector.source(2.0) == 'odometry' and not detector.is_still(2.0)
    for now in every(0.1, 2.1, 3.2):
        detector.images(0.9, now)
        detector.velocity('command', 0.0, 0.0, now)
    assert detector.source(3.2) == 'command' and detector.is_still(3.2)
    for now in every(0.1, 3.3, 4.4):
        detector.images(0.9, now)
    assert detector.source(4.4) == 'images' and not detector.is_still(4.4)
    for now in every(0.1, 4.5, 5.2):
        detector.images(0.01, now)
    assert detector.is_still(5.2)
    assert detector.source(6.3) is None and not detector.is_still(6.3)


def test_what_it_did_while_silent_nobody_knows() -> None:
    detector = StandstillDetector()
    for now in every(0.1, 0.0, 1.0):
        detector.velocity('odometry', 0.0, 0.0, now)
    assert detector.is_still(1.9) and not detector.is_still(2.1)
    detector.velocity('odometry', 0.0, 0.0, 3.0)
    assert not detector.is_still(3.0) and detector.is_still(3.6)


def test_a_clock_set_back() -> None:
    detector = StandstillDetector()
    for now in every(0.1, 100.0, 101.0):
        detector.velocity('odometry', 0.0, 0.0, now)
    assert detector.is_still(101.0) and not detector.is_still(5.0)
    detector.velocity('odometry', 0.0, 0.0, 5.0)
    assert not detector.is_still(5.0) and detector.is_still(5.6)


@given(st.lists(st.tuples(st.sampled_from(['odometry', 'command', 'images']), st.booleans(), st.floats(0.01, 1.5)),
                max_size=40))
def test_as_reckoned_from_all_that_was_told(told: Any) -> None:
    """Against the definition: the best source that spoke within `silence`, and all it said for `hold`."""
    detector, now, said = StandstillDetector(), 0.0, {'odometry': [], 'command': [], 'images': []}
    for source, still, later in told:
        now += later
        said[source].append((now, still))
        if source == 'images':
            detector.images(0.0 if still else 1.0, now)
        else:
            detector.velocity(source, 0.0 if still else 1.0, 0.0, now)
        assert detector.is_still(now) == reckoned(said, now)
        assert detector.is_still(now + 0.7) == reckoned(said, now + 0.7)


def reckoned(said: Dict[str, List[Tuple[float, bool]]], now: float) -> bool:
    for source in ('odometry', 'command', 'images'):
        if said[source] and now - said[source][-1][0] <= 1.0:
            since, after = None, now
            for time, still in reversed(said[source]):
                if not still or after - time > 1.0:
                    break
                since = after = time
            return since is not None and now - since >= 0.5
    return False
