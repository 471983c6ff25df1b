# SPDX-License-Identifier: BSD-3-Clause
"""A listener to what came by the way back, with a service that reports each execution.

    python3 -m evaluation.teleoperated

An execution is reported as a message of the topic SERVICE whose amount is the content of the call.
"""
import time
from typing import Any

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Bool, UInt32

from smokebot_udp.srv import SetFocus, SetFocusResponse

from . import listener

SERVICE = '/counted'

MODULE = (__name__,)
"""For Listener."""


def execute(request: Any) -> Any:
    """Report an execution; the content is the answer."""
    listener.write_line([SERVICE, None, time.time(), request.focus])
    return SetFocusResponse(True, request.focus)


def main() -> None:
    """Run the node."""
    listener.KINDS.update({
        'speed': (Twist, lambda message: message.linear.x),
        'flag': (Bool, lambda message: message.data),
        'number': (UInt32, lambda message: message.data),
    })
    listener.main(lambda: rospy.Service(SERVICE, SetFocus, execute))


if __name__ == '__main__':
    main()
