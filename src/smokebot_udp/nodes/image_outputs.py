# SPDX-License-Identifier: BSD-3-Clause
"""The further topics of an image stream: its calibration, a mask, compressed images, a view."""
import collections
import threading
from typing import Any, Callable, Deque, Mapping, Tuple, Type

import rospy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from ..codecs.wire import compressed
from ..codecs.wire.pixels import image_pixels
from ..limited_log import logerr
from ..mission.settings import SettingsStore
from ..streams.image.assembled import ShownImage
from ..streams.image.camera_info import info_topic
from .notice import Notice
from .opened import Part
from .view_publisher import ViewPublisher

MAX_WAITING = 8
"""Images whose calibration may come after them, as where a segment overtakes that of a change."""


class _Output(Part):
    """Publishes a further topic of an image stream."""

    def __init__(self, topic: str, message_class: Any, queue_size: int = 2) -> None:
        super().__init__()
        self._publisher = self._opened.topic(
            rospy.Publisher(topic, message_class, queue_size=queue_size, tcp_nodelay=True))


class MaskOutput(_Output):
    """Publishes the origin of each image's pixels, or their quality, see streams.image.assembled.

    :param topic: resolved topic of the images; the mask's is `mask` beside it
    """

    def __init__(self, topic: str, settings: SettingsStore, clock_offset: Callable[[], float], notice: Notice) -> None:
        super().__init__(rospy.names.namespace(topic) + 'mask', Image)

    def show(self, assembled: ShownImage) -> None:
        """Publish the mask of an image, if there is any subscriber."""
        if self._publisher.get_num_connections():
            image = assembled.message
            self._publisher.publish(Image(
                header=image.header, height=image.height, width=image.width, encoding='mono8', step=image.width,
                data=assembled.mask().tobytes()))


class ViewOutput(Part):
    """Publishes an annotated colour image for display.

    :param clock_offset: f() -> the robot's clock minus the operator's [s]
    :param notice: that it shows
    """

    def __init__(self, topic: str, settings: SettingsStore, clock_offset: Callable[[], float], notice: Notice) -> None:
        super().__init__()
        self._view = self._opened.add(ViewPublisher(settings.current, clock_offset))
        settings.subscribe(self._view.configure)
        notice.subscribe(self._view.set_notice)
        self._opened.callback(notice.unsubscribe, self._view.set_notice)

    def show(self, assembled: ShownImage) -> None:
        """Publish the view of an image soon."""
        image = assembled.message
        self._view.show(image_pixels(image), image.encoding, image.header, assembled.known_ratio, error=assembled.error,
                        arrival=assembled.arrival)


class CameraInfoOutput(_Output):
    """Publishes the calibration of each image, with its header: after the image, or when it comes.

    :param topic: resolved topic of the images; camera_info is beside it
    """

    def __init__(self, topic: str, settings: SettingsStore, clock_offset: Callable[[], float], notice: Notice) -> None:
        super().__init__(info_topic(topic), CameraInfo, MAX_WAITING)
        self._waiting: Deque[Tuple[Header, Callable[[], Any]]] = collections.deque(maxlen=MAX_WAITING)
        self._lock = threading.Lock()

    def show(self, assembled: ShownImage) -> None:
        """Publish the calibration of an image, if it is known."""
        if assembled.camera_info is not None:
            with self._lock:
                self._waiting.append((assembled.message.header, assembled.camera_info))
            self.renew()

    def renew(self) -> None:
        """Publish the calibrations of images that are known now. Any thread."""
        with self._lock:
            waiting = [(header, find, find()) for header, find in self._waiting]
            self._waiting.clear()
            self._waiting.extend((header, find) for header, find, info in waiting if info is None)
        for header, _, info in waiting:
            if info is not None:
                info.header = Header(stamp=header.stamp, frame_id=header.frame_id)      # rospy writes into it
                self._publisher.publish(info)


class CompressedOutput(_Output):
    """Publishes each image compressed, as image_transport does: 8 bits as JPEG, 16 bits as PNG.

    :param topic: resolved topic of the images; `compressed` is below it
    """

    def __init__(self, topic: str, settings: SettingsStore, clock_offset: Callable[[], float], notice: Notice) -> None:
        super().__init__(topic + '/compressed', CompressedImage)

    def show(self, assembled: ShownImage) -> None:
        """Publish an image, if there is any subscriber."""
        if not self._publisher.get_num_connections():
            return
        image = assembled.message
        try:
            description, data = compressed.encode(image_pixels(image), image.encoding)
        except ValueError as error:
            logerr(self._publisher.name, 'an image is not published: %s' % error)
            return
        header = Header(stamp=image.header.stamp, frame_id=image.header.frame_id)
        self._publisher.publish(CompressedImage(header=header, format=description, data=data))


OUTPUTS: Mapping[str, Type[Any]] = {'camera_info': CameraInfoOutput, 'publish_mask': MaskOutput,
                                    'publish_compressed': CompressedOutput, 'view_topic': ViewOutput}
"""{setting: class of the output}: there is an output if its setting is neither false nor empty."""
