# SPDX-License-Identifier: BSD-3-Clause
"""The frames of robots; integration/own_streams.test runs make_streams at a robot without map and base_link."""
from typing import Dict, List, Tuple

import pytest
from geometry_msgs.msg import TransformStamped
from std_msgs.msg import Header

from smokebot_udp.streams.proposed_frames import MAX_FRAMES, Placed, Tree, proposed_frames

Edges = List[Tuple[str, str]]

MOUNTS = [('rover', 'mast'), ('mast', 'camera_link'), ('camera_link', 'optical'), ('rover', 'laser')]
CAMERA, LASER = Placed('/image', 'sensor_msgs/Image', 'optical'), Placed('/scan', 'sensor_msgs/LaserScan', 'laser')
WHEELS = Placed('/odom', 'nav_msgs/Odometry', 'odom', 'rover')
COSTMAP, FLOOR = (Placed(topic, 'nav_msgs/OccupancyGrid', frame)
                  for topic, frame in (('/local_costmap', 'odom'), ('/plan', 'floor')))


def tree_of(moving: Edges, static: Edges) -> Tree:
    tree = Tree()
    for edges, is_static in ((moving, False), (static, True)):
        tree.add([TransformStamped(Header(frame_id=parent), child, None) for parent, child in edges], is_static)
    return tree


def frames(fixed: str, base: str) -> Dict[str, str]:
    return {'fixed': fixed, 'base': base}


@pytest.mark.parametrize('placed, moving, expected', [
    ([CAMERA, COSTMAP, WHEELS], [('odom', 'rover')], ('odom', 'rover')),
    ([CAMERA, COSTMAP, WHEELS], [('map', 'odom'), ('odom', 'rover')], ('map', 'rover')),
    ([COSTMAP, FLOOR, WHEELS], [('earth', 'floor'), ('floor', 'odom'), ('odom', 'rover')], ('floor', 'rover')),
    ([WHEELS], [('utm', 'odom'), ('odom', 'rover')], ('odom', 'rover')),
    ([CAMERA], [('world', 'rover')], ('world', 'rover')),
    ([CAMERA, LASER], [('world', 'rover')], ('world', 'rover')),
    ([WHEELS, FLOOR], [('odom', 'rover'), ('map', 'floor')], ('odom', 'rover')),    # no localisation yet
    ([WHEELS], [], ('rover', 'rover')),     # odometry without a transform: nothing is known in odom
    ([WHEELS._replace(frame='/odom', child='/rover')], [('/odom', '/rover')], ('odom', 'rover')),
    ([LASER, COSTMAP._replace(frame='rover')], [('odom', 'rover')], ('odom', 'rover'))])   # a map that goes along
def test_a_robot(placed: List[Placed], moving: Edges, expected: Tuple[str, str]) -> None:
    assert proposed_frames(placed, tree_of(moving, MOUNTS)) == frames(*expected)


def test_a_camera_that_turns_and_a_robot_all_of_whose_transforms_are_in_tf() -> None:
    assert proposed_frames([CAMERA, LASER], tree_of([('odom', 'rover'), ('rover', 'mast')], [
        ('mast', 'optical'), ('rover', 'laser')])) == frames('odom', 'rover')
    assert proposed_frames([CAMERA, LASER], tree_of([('odom', 'rover'), *MOUNTS], [])) == frames('odom', 'rover')


def test_a_sensor_in_a_tree_of_its_own_does_not_count() -> None:
    alone = Placed('/thermal', 'sensor_msgs/Image', 'flir')
    tree = tree_of([('odom', 'rover')], [*MOUNTS, ('flir_link', 'flir')])
    assert proposed_frames([alone, CAMERA, LASER], tree) == frames('odom', 'rover')


def test_of_several_odometries_the_one_that_tf_knows() -> None:
    visual = Placed('/a', 'nav_msgs/Odometry', 'camera_odom', 'camera_pose')
    assert proposed_frames([visual, WHEELS], tree_of([('odom', 'rover')], [])) == frames('odom', 'rover')


def test_a_robot_without_transforms() -> None:
    assert proposed_frames([CAMERA], Tree()) == {}
    assert proposed_frames([CAMERA, COSTMAP], Tree()) == {'fixed': 'odom'}
    assert proposed_frames([CAMERA, WHEELS], Tree()) == frames('odom', 'rover')


@pytest.mark.parametrize('frame', ['', 'a b', 'x: y', "x'", 'x\n', 'x#', 'r' * 101, '\u043c', '-x', '{}', '/', '\0'])
def test_illegal_names_are_ignored(frame: str) -> None:
    placed = [Placed('/a', 'nav_msgs/Odometry', frame, frame), Placed('/b', 'nav_msgs/OccupancyGrid', frame), CAMERA]
    tree = tree_of([('odom', 'rover'), (frame, 'odom'), ('rover', frame), (frame, frame)], MOUNTS)
    assert proposed_frames(placed, tree) == frames('odom', 'rover')
    assert proposed_frames(placed[:2], Tree()) == {}


@pytest.mark.parametrize('edges', [
    [('odom', 'rover'), ('rover', 'odom')], [('rover', 'rover')],
    [('odom', 'rover'), ('map', 'odom'), ('odom', 'map')]])
def test_a_loop_ends(edges: Edges) -> None:
    for moving, static in ((edges, MOUNTS), ([], edges + MOUNTS)):
        found = proposed_frames([CAMERA, WHEELS], tree_of(moving, static))
        assert found['base'] == 'rover' and found['fixed'] in ('odom', 'map', 'rover')
        assert proposed_frames([CAMERA, LASER], tree_of(moving, static))


def test_a_tree_without_end_is_cut() -> None:
    tree = tree_of([('frame_%d' % number, 'frame_%d' % (number + 1)) for number in range(3 * MAX_FRAMES)], [])
    assert 'frame_%d' % MAX_FRAMES in tree and 'frame_%d' % (MAX_FRAMES + 1) not in tree
    assert len(tree.above('frame_%d' % MAX_FRAMES)) == MAX_FRAMES
