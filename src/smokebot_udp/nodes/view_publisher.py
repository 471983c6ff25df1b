# SPDX-License-Identifier: BSD-3-Clause
"""Publishes the view of an image stream for display in rviz."""
import time
from typing import Any, Callable, Mapping, Optional

import rospy
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from ..arrays import Array
from ..image_error import ImageError
from ..limited_log import logerr
from ..streams.image.view import View, ViewedImage
from .common import operator_topic
from .worker import DeadlineWorker


class ViewPublisher:
    """Publishes sensor_msgs/Image bgr8 with the source's header, as streams.image.view.View decides.

    Before the first image it publishes a grey one that says so: an empty display might also have a wrong topic.

    :param settings: {name: value} with those of streams.image.view.PARAMETERS, checked
    :param clock_offset: f() -> the robot's clock minus the operator's [s]
    :param frame: frame_id before the first image
    """

    def __init__(self, settings: Mapping[str, Any], clock_offset: Callable[[], float], frame: str = '') -> None:
        self._clock_offset = clock_offset
        self._view = View(settings, Header(frame_id=frame))
        self._publisher = rospy.Publisher(operator_topic(settings['view_topic']), Image, queue_size=2, tcp_nodelay=True)
        self._worker: DeadlineWorker[ViewedImage] = DeadlineWorker(
            'view', lambda now: self._view.poll(now, self.wanted), self._view.deadline, self._publish, self._report)
        self._worker.start()

    @property
    def wanted(self) -> bool:
        """Whether there is any subscriber."""
        return bool(self._publisher.get_num_connections() > 0)

    def configure(self, settings: Mapping[str, Any], changed: Mapping[str, Any]) -> None:
        """Apply changed settings, see View.configure."""
        with self._worker.changing():
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

    def close(self) -> None:
        self._worker.close()
        self._publisher.unregister()

    def _publish(self, image: ViewedImage) -> None:
        view = self._view.draw(image, time.monotonic())
        header = Header(stamp=image.header.stamp, frame_id=image.header.frame_id)   # rospy writes into it
        if not rospy.is_shutdown():
            self._publisher.publish(Image(header=header, height=view.shape[0], width=view.shape[1], encoding='bgr8',
                                          step=view.strides[0], data=view.tobytes()))

    def _report(self, error: Exception) -> None:
        logerr(self._publisher.name, 'an image is not shown: %s' % error)
