# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot where somebody drives it; test_simulation.py has its tour."""
from typing import Any, List, Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.simulation.course import TURN_RATE, Course
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.motion import RADIUS, Arc, free_duration
from smokebot_udp.simulation.odometry import Odometry
from smokebot_udp.simulation.planner import Planner
from smokebot_udp.simulation.pose import compose
from smokebot_udp.simulation.robot import REACHED, WATCHDOG, Robot
from smokebot_udp.simulation.world import CEILING, Prism, World, building

PAUSE = 30.0
BUILDING = building(1)
PLANNER = Planner(BUILDING)
WALL = World([Prism('wall', (3.0, 0.0), (2.0, 8.0), 0.0, 0.0, CEILING, 20.0, (30, 30, 30))])    # from x = 2 on


def robot() -> Robot:
    return Robot(Drive(), BUILDING, PLANNER, speed=0.7, pause=PAUSE)


def clearance(where: Any, times: Any) -> float:
    return float(BUILDING.distances(np.array([where.pose(float(time))[:2] for time in times])).min())


def same_direction(one: float, other: float) -> bool:
    return bool(np.cos(one - other) > 1 - 1e-9)


def test_a_course_drives_turns_and_halts() -> None:
    course = Course((0.0, 0.0, 0.0), [((2.0, 0.0), 3.0), ((2.0, 1.0), 0.0)], np.pi, speed=0.5)
    turn = np.pi / 2 / TURN_RATE
    assert course.duration == pytest.approx(4 + 3 + turn + 2 + turn) and course.length == 3.0
    assert course.pose(2.0) == (1.0, 0.0, 0.0) and course.pose(5.0) == (2.0, 0.0, 0.0)
    assert course.pose(7 + turn + 1) == pytest.approx((2.0, 0.5, np.pi / 2))
    assert course.pose(-1.0) == (0.0, 0.0, 0.0) and course.pose(99.0) == pytest.approx((2.0, 1.0, np.pi))
    assert course.travelled(99.0) == 3.0 and course.turned == pytest.approx(np.pi)


def test_a_course_turns_the_shorter_way_and_its_yaw_does_not_jump() -> None:
    course = Course((0.0, 0.0, 3.0), [], -3.0, speed=0.5)
    assert course.duration == pytest.approx((2 * np.pi - 6) / TURN_RATE)
    assert course.pose(99.0)[2] == pytest.approx(2 * np.pi - 3)


def test_an_arc_by_hand() -> None:
    quarter = Arc((1.0, 2.0, 0.0), 1.0, 0.5, 99.0).pose(np.pi)      # on a circle of 2 m to the left
    assert quarter == pytest.approx((3.0, 4.0, np.pi / 2))
    backwards = Arc((0.0, 0.0, np.pi / 2), -0.4, 0.0, 0.5)
    assert backwards.pose(0.25) == pytest.approx((0.0, -0.1, np.pi / 2)) and backwards.pose(9.0)[1] == -0.2
    assert backwards.travelled(9.0) == 0.2


@pytest.mark.parametrize('start,forward,expected', [
    (0.0, 1.0, 0.5),                # 2 m before the wall
    (1.5, 1.0, 0.2),                # touches at x = 1.7
    (1.7, 1.0, 0.0), (1.7, -1.0, 0.5), (1.8, -1.0, 0.5), (1.8, 1.0, 0.0)])
def test_an_arc_ends_before_a_wall(start: float, forward: float, expected: float) -> None:
    assert free_duration(WALL, Arc((start, 0.0, 0.0), forward, 0.0, 0.5)) == pytest.approx(expected, abs=0.011)


def test_nothing_is_in_the_way_of_a_turn_or_of_a_drive_along_a_wall() -> None:
    for pose, forward, turn in (((1.65, 0.0, 0.0), 0.0, 1.0), ((1.7, -1.0, np.pi / 2), 1.0, 0.0)):
        assert free_duration(WALL, Arc(pose, forward, turn, 0.5)) == 0.5


@pytest.mark.parametrize('seed', range(4))
def test_ways_lead_through_the_doors_and_touch_nothing(seed: int) -> None:
    world = building(seed)
    planner, random = Planner(world), np.random.RandomState(seed)
    points: List[Tuple[float, float]] = [(1.5, 7.0)]
    while len(points) < 12:
        point = random.uniform((0.3, 0.3), (20.7, 13.7))
        if world.distance(point) > 0.45:
            points.append((float(point[0]), float(point[1])))
    for start, goal in zip(points, points[1:]):
        way = planner.way(start, goal)
        assert way[-1] == goal and len(way) < 12
        course = Course((*start, 0.0), [(point, 0.0) for point in way], None, 1.0)
        assert world.distances(np.array([course.pose(time)[:2] for time in np.arange(0, course.duration, 0.02)])
                               ).min() > RADIUS - 1e-6
        assert course.length < 1.5 * np.hypot(*np.subtract(goal, start)) + 12.0


def test_a_way_that_is_straight_is_straight() -> None:
    way = PLANNER.way((1.5, 7.0), (17.0, 7.0))
    assert way[-1] == (17.0, 7.0) and len(way) <= 3 and all(abs(y - 7.0) < 0.1 for _, y in way)


@pytest.mark.parametrize('goal,reason', [((-1.0, 3.0), 'outside'), ((3.0, 99.0), 'outside'),
                                         ((21.0 - 1e-6, 14.0 - 1e-6), 'obstacle'), ((float('nan'), 1.0), 'outside')])
def test_goals_that_cannot_be_reached_are_refused_with_a_reason(goal: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        PLANNER.way((1.5, 7.0), goal)


def test_a_goal_in_a_wall_is_moved_to_where_the_robot_can_stand() -> None:
    x, y = PLANNER.way((1.5, 7.0), (10.0, 8.35))[-1]
    assert BUILDING.distance((x, y)) > RADIUS and np.hypot(x - 10.0, y - 8.35) < 0.5
    assert PLANNER.way((1.5, 7.0), (10.0, 7.3))[-1] == (10.0, 7.3)


def test_a_room_without_a_door_has_no_way() -> None:
    walls = [Prism(str(i), centre, size, 0.0, 0.0, CEILING, 20.0, (0, 0, 0)) for i, (centre, size) in enumerate((
        ((10.0, 3.0), (4.0, 0.2)), ((10.0, 7.0), (4.0, 0.2)), ((8.0, 5.0), (0.2, 4.0)), ((12.0, 5.0), (0.2, 4.0))))]
    with pytest.raises(ValueError, match='no way'):
        Planner(World(walls)).way((2.0, 2.0), (10.0, 5.0))


def test_the_tour_is_untouched_while_nobody_drives() -> None:
    one, drive = robot(), Drive()
    for time in np.arange(0.0, 3 * drive.period, 7.3):
        assert one.pose(time) == drive.pose(time) and one.travelled(time) == drive.travelled(time)
        assert one.twist(time) == drive.twist(time)
    assert Odometry(one).pose(99.0) == Odometry(drive).pose(99.0)


def test_a_command_ends_by_the_watchdog() -> None:
    one = robot()
    start = one.pose(2.0)
    one.command(0.4, 0.0, 2.0)
    assert one.twist(2.2) == pytest.approx((0.4, 0.0)) and one.twist(2.0 + WATCHDOG + 0.01) == (0.0, 0.0)
    assert one.pose(20.0) == pytest.approx(compose(start, (0.4 * WATCHDOG, 0.0, 0.0)))
    assert one.travelled(20.0) == pytest.approx(one.travelled(2.0) + 0.2)


def test_the_newest_command_is_obeyed_and_the_past_stays() -> None:
    one = robot()
    for number in range(40):
        one.command(0.5, 0.0, 2.0 + 0.05 * number)
    one.command(0.0, -1.0, 4.0)
    assert one.twist(4.1) == pytest.approx((0.0, -1.0)) and one.twist(3.9) == pytest.approx((0.5, 0.0))
    assert one.pose(3.0)[0] - one.pose(2.0)[0] == pytest.approx(0.5)


@pytest.mark.parametrize('forward,turn', [(float('nan'), 0.0), (0.5, float('inf')), (0.0, 0.0)])
def test_what_is_no_number_stops_it(forward: float, turn: float) -> None:
    one = robot()
    one.command(0.5, 0.5, 2.0)
    one.command(forward, turn, 2.1)
    assert one.pose(2.1) == one.pose(3.0) and one.twist(2.2) == (0.0, 0.0)


def test_after_a_clock_has_stepped_back_a_command_still_ends() -> None:
    one = robot()
    for number in range(40):
        one.command(0.5, 0.0, 100.0 + 0.05 * number)
    assert one.pose(50.0) == Drive().pose(50.0)     # it is where it was then
    one.command(0.0, 0.8, 50.0)
    assert one.twist(50.2) == pytest.approx((0.0, 0.8)) and one.pose(50.0 + WATCHDOG) == one.pose(70.0)
    one.command(0.0, 0.8, 1e6)      # and forward
    assert one.pose(1e6 + WATCHDOG) == one.pose(1e6 + WATCHDOG + 20.0)


def test_commands_are_limited() -> None:
    one = robot()
    one.command(99.0, -99.0, 2.0)
    assert one.twist(2.1) == pytest.approx((1.5, -2.0), rel=1e-2)


def test_it_stops_before_a_wall_turns_there_and_drives_away() -> None:
    one = robot()
    for number in range(200):
        one.command(1.0, 0.0, 2.0 + 0.1 * number)       # along the corridor to its end, or to what stands there
    stopped = one.pose(22.0)
    assert BUILDING.distance(stopped[:2]) == pytest.approx(RADIUS, abs=0.02) and one.twist(21.95) == (0.0, 0.0)
    one.command(1.0, 1.0, 22.0)
    assert one.pose(22.4) == pytest.approx((*stopped[:2], stopped[2] + 0.4), abs=0.011)
    one.command(-1.0, 0.0, 22.4)
    assert BUILDING.distance(one.pose(22.9)[:2]) > RADIUS + 0.2


def test_it_goes_back_and_goes_on_with_its_tour_after_the_pause() -> None:
    one, drive = robot(), Drive()
    left = drive.pose(12.0)
    for number in range(40):
        one.command(-0.5, 0.0, 12.0 + 0.1 * number)
    last = 12.0 + 3.9
    stood = one.pose(last + WATCHDOG)
    assert np.hypot(*np.subtract(stood[:2], left[:2])) > 1.5
    assert one.pose(last + PAUSE - 0.01) == pytest.approx(stood) and one.twist(last + PAUSE - 0.1) == (0.0, 0.0)
    times = last + PAUSE + np.arange(0.0, 60.0, 0.05)
    poses = [one.pose(time) for time in times]
    assert clearance(one, times[-90:]) > RADIUS - 1e-6
    back = next(i for i, pose in enumerate(poses)
                if np.allclose(pose[:2], left[:2], atol=0.02) and same_direction(pose[2], left[2]))
    begun = next(time for time in np.arange(times[back], times[back] + 1, 0.001)
                 if np.allclose(one.pose(time)[:2], drive.pose(12.05)[:2], atol=1e-3)) - 0.05
    for later in (1.0, 5.0, 20.0):
        assert one.pose(begun + later)[:2] == pytest.approx(drive.pose(12.0 + later)[:2], abs=2e-3)


def test_a_goal_is_reached_and_the_robot_stays_there_for_the_pause() -> None:
    one = robot()
    number = one.go_to((17.5, 11.0, 1.0), 5.0)
    assert one.outcome(number, 6.0) is None
    times = np.arange(5.0, 120.0, 0.05)
    outcomes, poses = zip(*((one.outcome(number, time), one.pose(time)) for time in times))
    steps = np.hypot(*np.diff([pose[:2] for pose in poses], axis=0).T)
    assert steps.max() < 0.7 * 0.05 + 1e-6
    reached = outcomes.index(REACHED)
    assert 20 < times[reached] < 60 and set(outcomes[:reached]) == {None}
    assert poses[reached][:2] == pytest.approx((17.5, 11.0)) and same_direction(poses[reached][2], 1.0)
    stands = int(PAUSE / 0.05) - 1
    assert not steps[reached:reached + stands].any() and steps[reached + stands + 10:].any()


def test_a_goal_is_given_up_for_a_command_and_none_is_taken_meanwhile() -> None:
    one = robot()
    number = one.go_to((17.5, 11.0, 0.0), 5.0)
    one.command(0.0, 0.0, 8.0)
    assert one.outcome(number, 8.0) == 'it was driven by commands' and one.pose(8.0) == one.pose(20.0)
    with pytest.raises(ValueError, match='driven by commands'):
        one.go_to((10.5, 7.0, 0.0), 8.1)
    assert one.go_to((10.5, 7.0, 0.0), 8.0 + WATCHDOG) == 2


def test_another_goal_and_a_cancelled_one() -> None:
    one = robot()
    first = one.go_to((17.5, 11.0, 0.0), 5.0)
    second = one.go_to((3.5, 11.0, 0.0), 7.0)
    assert one.outcome(first, 7.0) == 'another goal came' and one.outcome(second, 7.0) is None
    one.cancel(first, 7.1)
    assert one.outcome(second, 7.1) is None
    one.cancel(second, 7.2)
    assert one.outcome(second, 7.2) == 'it was cancelled' and one.twist(7.5) == (0.0, 0.0)


def test_a_goal_that_cannot_be_reached_changes_nothing() -> None:
    one = robot()
    for goal in ((0.0, 0.01, 0.0), (3.5, 7.0, float('nan'))):
        with pytest.raises(ValueError):
            one.go_to(goal, 5.0)
    assert one.pose(50.0) == Drive().pose(50.0)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.floats(-2, 2), st.floats(-3, 3), st.floats(0.0, 1.0)), min_size=1, max_size=60))
def test_whatever_is_commanded_it_touches_nothing_and_never_jumps(commands: List[Tuple[float, float, float]]) -> None:
    one, time = robot(), 0.0
    for forward, turn, pause in commands:
        one.command(forward, turn, time)
        time += pause
    times = np.arange(max(0.0, time - 4.0), time + 1.0, 0.02)
    poses = np.array([one.pose(when)[:2] for when in times])
    assert BUILDING.distances(poses).min() > RADIUS - 1e-3
    assert np.hypot(*np.diff(poses, axis=0).T).max() < 1.5 * 0.02 + 1e-6
