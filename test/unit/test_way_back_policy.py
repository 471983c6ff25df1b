# SPDX-License-Identifier: BSD-3-Clause
"""What is refused on a link without a key."""
from typing import Any, Set

import pytest

from smokebot_udp.nodes.way_back_policy import refused
from smokebot_udp.streams import config

TEXT = """
streams:
  thermal: {type: image, robot_topic: /thermal/image_raw, operator_topic: /operator/thermal/image_raw}
  cmd_vel: {type: command, message_type: geometry_msgs/Twist, operator_topic: /operator/cmd_vel, robot_topic: /cmd_vel}
  count: {type: service, service_type: std_srvs/Trigger, robot_service: /count, operator_service: /operator/count}
  move: {type: action, action_type: move_base_msgs/MoveBaseAction, robot_action: /move, operator_action: /operator/move}
  goal: {type: relay, message_type: geometry_msgs/PoseStamped, robot_topic: /goal, operator_topic: /operator/goal,
         reliable: true, direction: to_robot}
  log: {type: relay, message_type: rosgraph_msgs/Log, robot_topic: /rosout_agg, operator_topic: /operator/rosout,
        reliable: true}
"""
DEFINITIONS, PROBLEMS = config.load(TEXT)


class Link:
    """What the policy looks at of a transport."""

    def __init__(self, own_masters: bool, sealed: bool) -> None:
        self.own_masters, self.sealed = own_masters, sealed


@pytest.mark.parametrize('own_masters, sealed, allowed, expected', [
    (True, False, False, {'cmd_vel', 'count', 'move', 'goal'}),
    (True, False, True, set()),
    (True, True, False, set()),
    (False, False, False, set()),
    (False, False, True, set())])
def test_what_operators_send_the_robot_needs_a_key(own_masters: bool, sealed: bool, allowed: bool,
                                                   expected: Set[str]) -> None:
    link: Any = Link(own_masters, sealed)
    assert not PROBLEMS
    assert set(refused(DEFINITIONS, link, allowed)) == expected


def test_one_sentence_says_what_to_do() -> None:
    link: Any = Link(own_masters=True, sealed=False)
    assert refused(DEFINITIONS, link, allowed=False)['cmd_vel'] == (
        "stream 'cmd_vel' (command) is refused: the link has no key, so anybody on the network could use it; give both "
        'sides a key_file, or set allow_unsealed_commands on both')
