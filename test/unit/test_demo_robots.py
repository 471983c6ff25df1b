# SPDX-License-Identifier: BSD-3-Clause
"""What the demo of several robots writes; integration/demo.test runs it."""
from smokebot_udp.demo.robots import picture_of, robots_yaml
from smokebot_udp.mission.robots import load


def test_the_desk_reads_the_robots() -> None:
    robots, problems = load(robots_yaml({'ugv1': 17001, 'ugv2': 40000}, 'demo.key'))
    assert problems == []
    assert [(name, *(robot[setting] for setting in ('host', 'port', 'frame_prefix', 'key_file')))
            for name, robot in robots.items()] == [
        ('ugv1', '127.0.0.1', 17001, 'ugv1/', 'demo.key'), ('ugv2', '127.0.0.1', 40000, 'ugv2/', 'demo.key')]


def test_each_robot_has_a_picture_of_its_own() -> None:
    assert picture_of('ugv1', '/tmp/a.b/demo.png') == '/tmp/a.b/demo_ugv1.png' and picture_of('ugv1', '') == ''
