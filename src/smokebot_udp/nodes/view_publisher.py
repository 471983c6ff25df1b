# SPDX-License-Identifier: BSD-3-Clause
"""Publishes the view of an image stream for display in rviz, and its parts for displays that draw their own."""
import math
import time
from typing import Any, Callable, Mapping, Optional

import numpy as np
import rospy
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from ..arrays import Array
from ..codecs.display.view import FROZEN, dimmed
from ..image_error import ImageError
from ..limited_log import logerr
from ..msg import ViewImage
from ..streams.image.view import Judged, View, ViewedImage
from .common import operator_topic
from .opened import Part
from .worker import DeadlineWorker

PLAIN = '/plain'
"""Appended to the topic of a view: the topic of its parts."""

COLOURS = 16
"""Number of colours of the palette in ViewImage."""


class ViewPublisher(Part):
    """Publishes sensor_msgs/Image bgr8 with the source's header, as streams.image.view.View decides, and
    ViewImage on its topic with PLAIN appended.

    Before the first image it publishes a grey one that says so: an empty display might also have a wrong topic.

    :param settings: {name: value} with those of streams.image.view.PARAMETERS, checked
    :param clock_offset: f() -> the robot's clock minus the operator's [s]
    :param frame: frame_id before the first image
    """

    def __init__(self, settings: Mapping[str, Any], clock_offset: Callable[[], float], frame: str = '') -> None:
        super().__init__()
        self._clock_offset = clock_offset
        self._settings = settings
        self._view = View(settings, Header(frame_id=frame))
        topic = operator_topic(settings['view_topic'])
        self._plain = self._opened.topic(rospy.Publisher(topic + PLAIN, ViewImage, queue_size=2, tcp_nodelay=True))
        self._publisher = self._opened.topic(rospy.Publisher(topic, Image, queue_size=2, tcp_nodelay=True))
        self._worker: DeadlineWorker[ViewedImage] = self._opened.started(DeadlineWorker(
            'view', lambda now: self._view.poll(now, self.wanted), self._view.deadline, self._publish, self._report))

    @property
    def wanted(self) -> bool:
        """Whether there is any subscriber."""
        return any(one.get_num_connections() > 0 for one in (self._publisher, self._plain))

    def configure(self, settings: Mapping[str, Any], changed: Mapping[str, Any]) -> None:
        """Apply changed settings, see View.configure."""
        with self._worker.changing():
            self._settings = settings
            self._view.configure(settings, changed)

    def set_notice(self, text: str) -> None:
        """Show a notice from now on; empty: none."""
        with self._worker.changing():
            self._view.set_notice(text)

    def show(self, pixels: Array, encoding: str, header: Any, completeness: float,
             now: Optional[float] = None, error: Optional[ImageError] = None, arrival: int = 0) -> None:
        """Publish the view of an image soon, in a thread of its own.

        :param pixels: (height, width) or (height, width, channels) array, see codecs.wire.pixels.as_pixels; it is kept
        :param encoding: as in sensor_msgs/Image
        :param header: std_msgs/Header of the source
        :param completeness: share of the pixels that are not concealed, 0..1
        :param now: by the operator's ROS clock; None: now [s]
        :param error: of an image that was coded with loss
        :param arrival: as of Assembled [ns]
        """
        now = rospy.get_time() if now is None else now
        age = now + self._clock_offset() - (1e-9 * arrival if arrival else header.stamp.to_sec())
        with self._worker.changing():
            self._view.add(ViewedImage(header, completeness, age, time.monotonic(), pixels, encoding,
                                       error=error, at_least=bool(arrival)))

    def _publish(self, image: ViewedImage) -> None:
        now = time.monotonic()
        header = Header(stamp=image.header.stamp, frame_id=image.header.frame_id)   # rospy writes into it
        if self._publisher.get_num_connections():
            view = self._view.draw(image, now)
            if not rospy.is_shutdown():
                self._publisher.publish(Image(header=header, height=view.shape[0], width=view.shape[1],
                                              encoding='bgr8', step=view.strides[0], data=view.tobytes()))
        if self._plain.get_num_connections():
            parts = view_image(header, image, self._view.judge(image, now), self._settings)
            if not rospy.is_shutdown():
                self._plain.publish(parts)

    def _report(self, error: Exception) -> None:
        logerr(self._publisher.name, 'an image is not shown: %s' % error)


def view_image(header: Any, image: ViewedImage, shown: Judged, settings: Mapping[str, Any]) -> Any:
    """The ViewImage of an image.

    :param header: of the message
    :param settings: {name: value} with those of streams.image.view.PARAMETERS
    """
    coloured, judgement = shown.coloured, shown.judgement
    pixels = dimmed(coloured.pixels) if judgement.state == FROZEN else coloured.pixels
    palette = b''
    if coloured.palette is not None:
        places = np.linspace(0, len(coloured.palette) - 1, COLOURS).astype(int)
        palette = coloured.palette[places].tobytes()
    per_unit = settings['counts_per_unit']
    return ViewImage(
        header=header, state=judgement.state, old=judgement.old, poor=judgement.poor, age=judgement.age,
        at_least=image.at_least, old_after=shown.limits.old_after, frozen_after=shown.limits.frozen_after,
        quality=judgement.quality, completeness=image.completeness,
        error=math.nan if image.error is None else image.error.rms / per_unit, counts_per_unit=per_unit,
        zero=settings['zero'], unit=settings['unit'], numbers=list(coloured.numbers), palette=palette,
        notice=shown.notice, height=pixels.shape[0], width=pixels.shape[1],
        data=np.ascontiguousarray(pixels).tobytes())
