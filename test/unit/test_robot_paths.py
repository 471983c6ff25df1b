# SPDX-License-Identifier: BSD-3-Clause
"""The rules at the head of robot_paths, over simulated paths."""
from random import Random
from typing import Any, Callable, List, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.link.place import Place
from smokebot_udp.link.robot_paths import (
    IDLE_PROBE,
    MAX_SILENCE,
    PROBE,
    SHARED_FOR,
    SILENCE,
    STEADY,
    UNANSWERED,
    USED_PROBE,
    RobotPaths,
)

A, B, C = Place(1, 17001), Place(2, 17001), Place(3, 17001)
STEP = 0.01


class World:
    """Paths that lose probes; data come each 0.05 s over the used one.

    :param up, down: f(place, time) -> whether a packet is lost on the way to the robot, and back
    """

    def __init__(self, up: Callable[[Any, float], bool], down: Callable[[Any, float], bool], places: Any = (A, B),
                 used: Any = A) -> None:
        self.paths = RobotPaths(places, used, 0.0)
        self.up, self.down = up, down
        self.changes: List[Tuple[float, Any]] = []
        self.probes: List[Tuple[float, Any]] = []
        self._answers: List[Tuple[float, bytes]] = []

    def run(self, begin: float, end: float) -> None:
        for step in range(round(begin / STEP), round(end / STEP)):
            now = step * STEP
            for path in self.paths.due(now):
                challenge = len(self.probes).to_bytes(8, 'little')
                path.ask(challenge, now)
                self.probes.append((now, path.place))
                if not self.up(path.place, now) and not self.down(path.place, now):
                    self._answers.append((now + 0.04, challenge))
            for due, challenge in [answer for answer in self._answers if answer[0] <= now]:
                assert self.paths.take(challenge, now)
                self._answers.remove((due, challenge))
            if step % 5 == 0 and not self.down(self.paths.used, now):
                self.paths.carried(now)
            if self.paths.choose(now):
                self.changes.append((now, self.paths.used))


def never(place: Any, now: float) -> bool:
    return False


def cut(*cuts: Tuple[Any, float, float]) -> Callable[[Any, float], bool]:
    """Nothing passes at a place from one time to another."""
    return lambda place, now: any(place == one and begin <= now < end for one, begin, end in cuts)


def test_what_probes_cost() -> None:
    world = World(never, never)
    world.run(0.0, 10.0)
    assert not world.changes
    for place, period in ((A, USED_PROBE), (B, IDLE_PROBE)):
        assert sum(one == place for _, one in world.probes) == pytest.approx(10.0 / period, abs=2)


def test_the_first_of_those_that_answer_follows_a_silent_one() -> None:
    lost = cut((A, 3.0, 9.0), (B, 0.0, 9.0))
    world = World(lost, lost, (A, B, C))
    world.run(0.0, 9.0)
    (when, place), = world.changes
    assert place == C and 3.0 + SILENCE - 0.05 <= when <= 3.0 + SILENCE + 0.1


def test_nothing_changes_where_no_path_answers() -> None:
    lost = cut((A, 3.0, 6.0), (B, 3.0, 6.0))
    world = World(lost, lost)
    world.run(0.0, 9.0)
    assert not world.changes
    in_doubt = [when for when, place in world.probes if place == B and 3.5 <= when < 5.5]
    assert len(in_doubt) == pytest.approx(2.0 / PROBE, abs=2)


def test_a_path_that_carries_to_this_side_only_is_left() -> None:
    world = World(cut((A, 3.0, 9.0)), never)
    world.run(0.0, 9.0)
    (when, place), = world.changes
    assert place == B and 3.0 + UNANSWERED - 0.1 <= when <= 3.0 + UNANSWERED + 0.1


def test_a_preferred_path_is_used_again_after_a_while_and_no_other_one() -> None:
    lost = cut((A, 3.0, 5.0))
    world = World(lost, lost)
    world.run(0.0, 30.0)
    (_, first), (when, second) = world.changes
    assert (first, second) == (B, A) and when == pytest.approx(5.0 + STEADY * IDLE_PROBE, abs=0.6)
    world = World(never, never, (A, B), B)
    world.run(0.0, 30.0)
    assert [place for _, place in world.changes] == [A]
    world = World(never, never, (A, B), A)
    world.run(0.0, 30.0)
    assert not world.changes


def test_a_path_that_pauses_is_used_again_at_once_and_waited_for_longer_then() -> None:
    pauses = [(A, float(second), second + 0.25) for second in range(2, 9)]
    world = World(never, cut(*pauses))
    world.run(0.0, 9.0)
    (left, first), (back, second) = world.changes
    assert (first, second) == (B, A) and left == pytest.approx(2.0 + SILENCE, abs=0.06)
    assert back == pytest.approx(2.25, abs=PROBE + 0.05)
    world = World(never, cut((A, 2.0, 2.25), (A, 3.0, 9.0)))
    world.run(0.0, 9.0)
    assert [place for _, place in world.changes] == [B, A, B]
    assert 3.0 + 2 * SILENCE < world.changes[-1][0] < 3.0 + MAX_SILENCE + 0.1


def test_a_preferred_path_of_high_loss_is_not_used_again() -> None:
    random = Random(1)
    world = World(lambda place, now: place == A and random.random() < 0.7, never, (A, B), B)
    world.run(0.0, 60.0)
    assert not world.changes


def test_an_answer_counts_once_and_a_forged_one_not_at_all() -> None:
    paths = RobotPaths([A, B], A, 0.0)
    paths.due(0.0)[0].ask(b'12345678', 0.0)
    assert not paths.take(b'87654321', 0.01)
    assert paths.take(b'12345678', 0.02) and not paths.take(b'12345678', 0.03)
    assert paths.paths[0].round_trip == pytest.approx(0.02)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 1 << 32), st.floats(0.0, 0.7), st.floats(0.0, 0.7), st.integers(2, 4))
def test_whatever_is_lost_changes_are_apart_and_what_is_due_is_known(seed: int, up: float, down: float,
                                                                     count: int) -> None:
    random, places = Random(seed), [Place(number, 1) for number in range(count)]
    world = World(lambda place, now: random.random() < up, lambda place, now: random.random() < down, places, places[0])
    world.run(0.0, 20.0)
    times = [0.0] + [when for when, _ in world.changes]     # those that were no return after a pause are apart
    assert all(later - earlier >= SILENCE - STEP for earlier, later in zip(times, times[count:]))
    assert world.paths.used in places
    for path in world.paths.due(20.0):
        path.ask(bytes(8), 20.0)
    assert 20.0 < world.paths.deadline(20.0) <= 20.0 + IDLE_PROBE


def test_the_second_path_is_the_first_other_one_that_answers() -> None:
    world = World(up=never, down=cut((B, 2.0, 5.0), (A, 6.0, 9.0)), places=(A, B, C))
    world.run(0.0, 1.0)
    assert world.paths.second(1.0) == B
    world.run(1.0, 4.0)
    assert world.paths.second(4.0) == C
    world.run(4.0, 6.0)
    assert world.paths.used == A and world.paths.second(6.0) == B
    world.run(6.0, 8.0)
    assert world.paths.used == B and world.paths.second(8.0) == C


def test_a_path_that_carries_a_part_is_asked_as_often_as_the_first_one() -> None:
    world = World(never, never)
    world.run(0.0, 3.0)
    world.paths.shared(B, 3.0)
    assert [path.place for path in world.paths.paths if path.is_shared(3.5)] == [B]
    world.probes.clear()
    world.run(3.0, 3.0 + SHARED_FOR)
    assert len([place for _, place in world.probes if place == B]) == pytest.approx(SHARED_FOR / USED_PROBE, abs=2)
    assert not any(path.is_shared(3.0 + SHARED_FOR) for path in world.paths.paths)
    world.paths.shared((99, 1), 5.0)        # a NAT hides the robot's address: it is the other one all the same
    assert [path.place for path in world.paths.paths if path.is_shared(5.0)] == [B]


def test_what_comes_by_another_path_does_not_keep_a_silent_one() -> None:
    """Data of the second path go on while the first one is cut."""
    world = World(never, cut((A, 1.0, 9.0)))
    for step in range(round(2.0 / STEP)):
        world.run(step * STEP, (step + 1) * STEP)
        if world.paths.used == A:
            world.paths.shared(B, step * STEP)
    assert world.changes and world.changes[0][0] < 1.0 + SILENCE + 0.1 and world.changes[0][1] == B
