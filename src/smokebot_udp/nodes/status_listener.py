# SPDX-License-Identifier: BSD-3-Clause
"""The robot's status as the operator received it last."""
from typing import Any, Dict, Optional

import rospy

from ..msg import RobotStatus
from .opened import Part
from .status_messages import problems_of


class StatusListener(Part):
    """Lives as long as its node.

    :param topic: topic on which the operator receives RobotStatus; None where no stream carries it
    """

    def __init__(self, topic: Optional[str]) -> None:
        super().__init__()
        self.status: Any = None
        """The robot's last RobotStatus; None: there was none."""
        if topic:
            self._opened.topic(rospy.Subscriber(topic, RobotStatus, self._take, queue_size=5))

    def _take(self, status: Any) -> None:
        self.status = status

    def problems(self) -> Dict[str, str]:
        """{stream: what is wrong with it on the robot}, as the robot reported last."""
        return problems_of(self.status) if self.status else {}

    def sent(self) -> Dict[str, Any]:
        """{stream: StreamStatus}, as the robot reported last."""
        status = self.status
        return {stream.name: stream for stream in status.streams} if status else {}
