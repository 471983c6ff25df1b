# SPDX-License-Identifier: BSD-3-Clause
"""The further topics of an image stream: a mask and a view."""
from typing import Any, Callable, Mapping, Type, Union

import rospy
from sensor_msgs.msg import Image

from ..codecs.wire.pixels import as_pixels
from ..mission.settings import SettingsStore
from ..streams.image.assembled import ShownImage
from .notice import Notice
from .view_publisher import ViewPublisher


class MaskOutput:
    """Publishes the origin of each image's pixels, or their quality, see streams.image.assembled.

    :param topic: resolved topic of the images; the mask's is `mask` beside it
    """

    def __init__(self, topic: str, settings: SettingsStore, clock_offset: Callable[[], float], notice: Notice) -> None:
        self._publisher = rospy.Publisher(rospy.names.namespace(topic) + 'mask', Image, queue_size=2, tcp_nodelay=True)

    def show(self, assembled: ShownImage) -> None:
        """Publish the mask of an image, if there is any subscriber."""
        if self._publisher.get_num_connections():
            image = assembled.message
            self._publisher.publish(Image(
                header=image.header, height=image.height, width=image.width, encoding='mono8', step=image.width,
                data=assembled.mask().tobytes()))

    def close(self) -> None:
        self._publisher.unregister()


class ViewOutput:
    """Publishes an annotated colour image for display.

    :param clock_offset: f() -> the robot's clock minus the operator's [s]
    :param notice: that it shows
    """

    def __init__(self, topic: str, settings: SettingsStore, clock_offset: Callable[[], float], notice: Notice) -> None:
        self._view, self._notice = ViewPublisher(settings.current, clock_offset), notice
        settings.subscribe(self._view.configure)
        notice.subscribe(self._view.set_notice)

    def show(self, assembled: ShownImage) -> None:
        """Publish the view of an image soon."""
        image = assembled.message
        pixels = as_pixels(image.data, image.height, image.width, image.step, image.encoding, image.is_bigendian)
        self._view.show(pixels, image.encoding, image.header, assembled.known_ratio, error=assembled.error)

    def close(self) -> None:
        self._notice.unsubscribe(self._view.set_notice)
        self._view.close()


Output = Union[MaskOutput, ViewOutput]
OUTPUTS: Mapping[str, Type[Any]] = {'publish_mask': MaskOutput, 'view_topic': ViewOutput}
"""{setting: class of the output}: there is an output if its setting is neither false nor empty."""
