# SPDX-License-Identifier: BSD-3-Clause
"""A path that drops without a queue is told from an air that loses, and bounds the rate."""
import math
import random
from typing import List

import pytest

from smokebot_udp.congestion.feedback import Feedback
from smokebot_udp.congestion.loss import Loss
from smokebot_udp.congestion.loss_ceiling import MIN_HOLD, LossCeiling

SIZE, INTERVAL = 1000, 0.1
RELAXED = 0.3e6
"""What is sent in the first second: no path drops that [byte/s]."""


class Path:
    """Reports each INTERVAL of what a sender that wants `wanted` byte/s loses on a path.

    :param policed: what passes [byte/s]
    :param air: loss ratio
    :param pace: at what rate datagrams leave, in bursts where less is wanted [byte/s]
    :param late: whether a rate takes effect a report later
    """

    def __init__(self, policed: float, air: float, wanted: float, seed: int = 0, pace: float = 0.0,
                 late: bool = False) -> None:
        self.policed, self.air, self.wanted, self.pace, self.late = policed, air, wanted, 0.0, late
        self.ceiling, self.loss, self.now = LossCeiling(), Loss(), 0.0
        self.offered: List[float] = []
        self.dropped = 0
        self._most = math.inf
        self._draw = random.Random(seed)
        wanted, self.wanted = self.wanted, RELAXED
        self.run(1)
        self.wanted, self.pace = wanted, pace

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / INTERVAL)):
            since, self.now = self.now, self.now + INTERVAL
            most, self._most = self._most if self.late else self.ceiling.rate, self.ceiling.rate
            offered = min(self.wanted, most)
            pace = max(offered, min(self.pace, most))
            count = round(offered * INTERVAL / SIZE)
            passed = round(count * min(1.0, self.policed / pace))
            received = sum(self._draw.random() >= self.air for _ in range(passed))
            feedback = Feedback([], math.nan, count, received, 0, False)
            self.loss.update(feedback, offered == RELAXED)
            self.ceiling.update(feedback, since, offered, pace, self.loss, self.now)
            self.offered.append(offered)
            self.dropped += count - passed


@pytest.mark.parametrize('wanted', [0.8e6, 1.5e6, 8e6])
@pytest.mark.parametrize('air', [0.0, 0.1])
def test_the_rate_stays_below_what_a_policer_lets_pass(wanted: float, air: float) -> None:
    path = Path(0.6e6, air, wanted)
    path.run(7)
    assert 0.85 * 0.6e6 <= path.ceiling.rate <= 1.05 * 0.6e6
    path.run(60)
    used = path.offered[-500:]
    assert sum(used) / len(used) >= 0.85 * 0.6e6
    assert sum(max(0.0, offered - 0.6e6) for offered in used) <= (0.02 + 0.2 * air) * sum(used)


@pytest.mark.parametrize('air', [0.02, 0.1, 0.3, 0.6, 0.9])
@pytest.mark.parametrize('seed', range(5))
def test_what_the_air_loses_is_no_ceiling(air: float, seed: int) -> None:
    path = Path(1e9, 0.0, 1e6, seed)
    path.run(3)
    path.air = air
    path.run(6)
    assert path.ceiling.rate == math.inf
    assert sum(path.offered[-30:]) >= 0.9 * 30 * 1e6


@pytest.mark.parametrize('pace', [0.8e6, 1.5e6, 6e6])
def test_a_path_is_used_by_streams_that_overran_it_in_bursts(pace: float) -> None:
    path = Path(0.6e6, 0.0, 0.55e6, pace=pace)
    path.run(6)
    assert 0.85 * 0.55e6 <= path.ceiling.rate <= 1.2 * 0.6e6
    path.run(2)
    assert 0.85 * 0.55e6 <= path.ceiling.rate <= 1.02 * 0.6e6
    path.dropped = 0
    path.run(30)
    assert path.dropped <= 0.01 * sum(path.offered[-300:]) * INTERVAL / SIZE


def test_what_leaves_before_a_check_takes_effect_does_not_count() -> None:
    path = Path(0.6e6, 0.0, 0.5e6, pace=6e6, late=True)
    path.run(9)
    assert sum(path.offered[-30:]) >= 0.85 * 30 * 0.5e6


def test_trials_find_a_path_that_has_become_wider() -> None:
    path = Path(0.6e6, 0.0, 5e6)
    path.run(5)
    assert path.ceiling.rate < 0.65e6
    path.policed = 1e9
    path.run(MIN_HOLD + 6)
    assert path.ceiling.rate == math.inf


def test_streams_that_use_little_of_the_ceiling_are_no_trial() -> None:
    path = Path(0.6e6, 0.0, 1.5e6)
    path.run(5)
    ceiling = path.ceiling.rate
    path.wanted = 0.5 * ceiling
    path.run(60)
    assert path.ceiling.rate == ceiling


def test_nothing_that_arrives_is_no_matter_of_the_rate() -> None:
    path = Path(1e9, 0.0, 1e6)
    path.run(3)
    path.air = 1.0
    path.run(6)
    assert path.ceiling.rate == math.inf
