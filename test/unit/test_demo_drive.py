# SPDX-License-Identifier: BSD-3-Clause
"""Whether the demo's robot obeys; integration/demo.test runs it."""
import math

import numpy as np
import pytest

from smokebot_udp.demo.drive import LATE, Topics, lateness, share_in_force, topics_of
from smokebot_udp.simulation.course import Course
from smokebot_udp.simulation.drive import Drive, ahead
from smokebot_udp.simulation.motion import RADIUS
from smokebot_udp.simulation.planner import Planner
from smokebot_udp.simulation.world import building

SENT = [0.0, 0.05, 0.10, 0.15]


@pytest.mark.parametrize('arrived,share', [
    ([], 0.0),
    ([(0.06, 0), (0.11, 1), (0.16, 2), (0.21, 3)], 1.0),
    ([(0.06, 1), (0.16, 3)], 1.0),                          # 0 and 2 were lost, but newer ones are there in time
    ([(0.06, 1), (0.18, 3)], 0.75),                         # too late for 2
    ([(0.01, 0), (0.16, 2), (0.17, 1)], 0.5),               # neither 1, which is late, nor 3
    ([(0.01, 3)], 1.0)])
def test_the_share_of_commands_in_force_by_hand(arrived, share: float) -> None:
    assert share_in_force(SENT, arrived, 0.07) == share


@pytest.mark.parametrize('waits,rate,text', [
    ([], 50.0, ''), ([0.001] * 200, 49.0, ''),
    ([0.001] * 99 + [0.5], 50.0, ''),                           # one in a hundred explains nothing
    ([0.001] * 19 + [LATE], 50.0, 'it woke 18 ms late one time in twenty'),
    ([0.0] * 90 + [0.03, 0.05] * 5, 50.0, 'it woke 50 ms late one time in twenty'),
    ([0.001], 23.7, 'it made 24 of 50 Hz of odometry'),
    ([0.2], 23.7, 'it woke 200 ms late one time in twenty, it made 24 of 50 Hz of odometry')])
def test_whether_the_machine_was_late(waits, rate: float, text: str) -> None:
    assert lateness(waits, rate) == text


def test_the_way_to_a_goal_takes_no_turns_to_the_centres_of_cells() -> None:
    drive = Drive()
    planner, seconds = Planner(building(1)), []
    for time in np.arange(0.0, drive.period, 1.7):
        pose = drive.pose(time)
        x, y, yaw = ahead(pose, 1.5)
        seconds.append(Course(pose, [(point, 0.0) for point in planner.way(pose[:2], (x, y))], yaw, 0.7).duration)
    # at most half a turn at 0.7 rad/s, a quarter of one, and 2.2 m at 0.7 m/s; of the 14 s that the report waits
    assert max(seconds) < 1.5 * math.pi / 0.7 + 2.2 / 0.7


def test_the_topics_by_which_the_robot_is_driven() -> None:
    goal = {'type': 'relay', 'reliable': True, 'direction': 'to_robot', 'robot_topic': '/move_base_simple/goal',
            'operator_topic': '/operator/goal'}
    command = {'type': 'command', 'robot_topic': '/cmd_vel', 'operator_topic': '/operator/cmd_vel'}
    log = {'type': 'relay', 'reliable': True, 'direction': 'to_operator', 'robot_topic': '/rosout_agg',
           'operator_topic': '/operator/rosout'}

    def found(**definitions) -> object:
        return topics_of(definitions, lambda topic: '/ugv1' + topic)
    assert found(a=log, b=command, c=goal) == Topics('/ugv1/operator/goal', '/ugv1/operator/cmd_vel',
                                                      '/ugv1/operator/control')
    assert found(a=log, b=command) is None and found(c=goal) is None


def test_a_goal_ahead_can_be_reached_from_everywhere_on_the_tour() -> None:
    world, drive = building(1), Drive()
    planner = Planner(world)
    for time in np.arange(0.0, drive.period, 1.7):
        pose = drive.pose(time)
        x, y, yaw = ahead(pose, 1.5)
        assert world.distance((x, y)) > RADIUS and planner.way(pose[:2], (x, y))
        assert math.hypot(x - pose[0], y - pose[1]) < 2.2
