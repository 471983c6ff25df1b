# SPDX-License-Identifier: BSD-3-Clause
"""The types that streams.yaml names."""
import pytest
from actionlib_msgs.msg import GoalID, GoalStatusArray
from move_base_msgs.msg import MoveBaseActionFeedback, MoveBaseActionGoal, MoveBaseActionResult
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger

from smokebot_udp.streams.message_types import action_types, message_class, service_class

UNKNOWN = ['no_such_msgs/Thing', 'std_msgs', '', 'std_msgs/NoSuchThing', 'a/b/c', '/', 'nav_msgs/', 'os/path']


def test_types_are_found_by_their_names() -> None:
    assert message_class('nav_msgs/Odometry') is Odometry
    assert service_class('std_srvs/Trigger') is Trigger
    assert action_types('move_base_msgs/MoveBaseAction') == (
        MoveBaseActionGoal, GoalID, GoalStatusArray, MoveBaseActionFeedback, MoveBaseActionResult)


@pytest.mark.parametrize('name', UNKNOWN)
@pytest.mark.parametrize('find, kind', [(message_class, 'message'), (service_class, 'service'),
                                        (action_types, 'action')])
def test_unknown_types_are_refused(name: str, find, kind: str) -> None:
    with pytest.raises(ValueError) as error:
        find(name)
    assert str(error.value) == '%s_type %r is no %s type that is installed here' % (kind, name, kind)


def test_a_message_is_no_service_and_no_action() -> None:
    with pytest.raises(ValueError, match="service_type 'nav_msgs/Odometry' is no service type"):
        service_class('nav_msgs/Odometry')
    with pytest.raises(ValueError, match='such as move_base_msgs/MoveBaseAction'):
        action_types('nav_msgs/Odometry')
    with pytest.raises(ValueError, match='such as move_base_msgs/MoveBaseAction'):
        action_types('move_base_msgs/MoveBaseGoal')
