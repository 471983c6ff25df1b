# SPDX-License-Identifier: BSD-3-Clause
"""The further topic of a map: how old each region of it is."""
from typing import Any, Callable, Optional

import rospy

from .logging import log_error
from .opened import Part
from .worker import PeriodicWorker

PERIOD = 1.0
"""Interval at which the ages, which are in seconds, are published again [s]."""


class AgeOutput(Part):
    """Publishes the ages of a map when it changed, and once a second; latched.

    :param topic: resolved topic of the map; `age` is below it, as several maps may share a namespace
    :param message_class: of the ages
    :param ages: f() -> the message; None: there is no map
    """

    def __init__(self, topic: str, message_class: Any, ages: Callable[[], Optional[Any]]) -> None:
        super().__init__()
        self._ages = ages
        self._publisher = self._opened.topic(
            rospy.Publisher(topic + '/age', message_class, queue_size=2, latch=True, tcp_nodelay=True))
        self._worker = self._opened.started(PeriodicWorker(
            'age', self._publish, log_error('%s: ages' % self._publisher.name), PERIOD))

    def show(self, assembled: Any) -> None:
        """Publish the ages of a new map soon."""
        self._worker.wake()

    def _publish(self) -> None:
        message = self._ages()
        if message is not None and not rospy.is_shutdown():
            self._publisher.publish(message)
