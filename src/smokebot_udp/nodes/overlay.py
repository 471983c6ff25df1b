# SPDX-License-Identifier: BSD-3-Clause
"""Publishes the overlay, an image with what an operator has to know at any time, see codecs.display.overlay."""
import math
import time
from typing import Any, Callable, Dict, Mapping, Optional, Tuple

import rospy
from sensor_msgs.msg import BatteryState, Image

from ..codecs.display.overlay import OperatorStatus, Tile, overlay, tiles
from ..msg import LinkStatus
from .logging import log_error
from .opened import Part
from .operator_control import IN_CONTROL, NO_COMMANDS, OperatorControl
from .status_listener import StatusListener
from .worker import PeriodicWorker

PERIOD = 0.2
"""How often it is looked whether anything has changed [s]."""

REPEAT_PERIOD = 1.0
"""The same image is repeated for new viewers [s]."""


class Overlay(Part):
    """Lives as long as its node. The link and the battery are those of the first stream with such messages.

    :param streams: {name: OperatorStream}, started
    :param topic: of the sensor_msgs/Image
    :param legend: see codecs.display.overlay.overlay
    :param signal: f() -> of the Wi-Fi on this side; NaN: unknown [dBm]
    :param problem: f() -> why nothing is received from the robot; None: there is no problem
    """

    def __init__(self, streams: Mapping[str, Any], robot: StatusListener, control: OperatorControl, topic: str,
                 legend: Mapping[str, Optional[Tuple[int, int, int]]], signal: Callable[[], float],
                 problem: Callable[[], Optional[str]]) -> None:
        super().__init__()
        self._robot, self._control, self._legend = robot, control, legend
        self._signal, self._problem = signal, problem
        self._sources = {class_: stream for stream in reversed(list(streams.values()))
                         for class_ in (LinkStatus, BatteryState) if stream.assembler.MESSAGE is class_}
        self._newest: Dict[Any, Any] = {}     # by class
        self._shown: Tuple[Tuple[Tile, ...], Tuple[str, ...]] = (), ()
        self._published = -math.inf     # [s]
        self._publisher = self._opened.topic(rospy.Publisher(topic, Image, queue_size=1, tcp_nodelay=True))
        for class_, stream in self._sources.items():
            self._opened.topic(rospy.Subscriber(stream.topic, class_, self._take, class_, queue_size=1))
        self._opened.started(PeriodicWorker('overlay', self._update, log_error('overlay'), PERIOD))

    def _take(self, message: Any, class_: Any) -> None:
        self._newest[class_] = message

    def _update(self) -> None:
        if not self._publisher.get_num_connections() or rospy.is_shutdown():
            return
        now = time.monotonic()
        status = self._status(now)
        shown = tiles(status), status.problems
        if shown == self._shown and now < self._published + REPEAT_PERIOD:
            return
        image = overlay(*shown, self._legend)
        self._publisher.publish(Image(height=image.shape[0], width=image.shape[1], encoding='bgr8',
                                      step=image.strides[0], data=image.tobytes()))
        self._shown, self._published = shown, now

    def _status(self, now: float) -> OperatorStatus:
        robot, link, battery = self._robot.status, self._newest.get(LinkStatus), self._newest.get(BatteryState)
        values: Dict[str, Any] = {}
        if link is not None:
            signals = [value for value in (link.wifi.signal, self._signal()) if math.isfinite(value)]
            values.update(sent=link.sent, capacity=link.capacity, loss=link.loss, round_trip=link.round_trip,
                          longest=link.longest_datagram, signal=min(signals, default=math.nan))
        if battery is not None:
            values.update(charge=battery.percentage, voltage=battery.voltage,
                          battery_age=self._silence(BatteryState, now))
        if robot is not None:
            values.update(focus=robot.focus, modified=robot.modified)
        problems = [self._problem(), *(robot.problems if robot is not None else ())]
        estop, driver, drives = self._control.situation()
        state = self._control.state
        return OperatorStatus(link_silence=self._silence(LinkStatus, now), control=state,
                              free=state.startswith(IN_CONTROL), commands=state != NO_COMMANDS, estop=estop,
                              driver=driver, drives=drives, problems=tuple(filter(None, problems)), **values)

    def _silence(self, class_: Any, now: float) -> float:
        """Time since the last message of a class [s]; infinite: there was none; NaN: no stream carries them."""
        stream: Optional[Any] = self._sources.get(class_)
        if stream is None:
            return math.nan
        return math.inf if stream.last_shown is None else now - stream.last_shown
