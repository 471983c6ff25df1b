# SPDX-License-Identifier: BSD-3-Clause
"""Compares the images of a stream on both sides, and draws the newest pair: as sent, and as the operator sees it."""
import collections
import math
import threading
from typing import Any, List, Mapping, Optional, Sequence, Tuple

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import Image

from ..arrays import Array, UInt8Array
from ..codecs.display.view import titled
from ..codecs.wire.pixels import image_pixels
from ..streams.image.view import colouring_of
from .comparison import Compared, Images

MAX_WAITING = 64
"""Number of sent images that wait for the received ones with the same stamps."""


class ImageComparison:
    """Compares the images of one stream on both sides.

    :param settings: of the stream; its topics are resolved
    :param drawn: whether the operator's view is to be drawn beside what was sent
    """

    def __init__(self, name: str, settings: Mapping[str, Any], drawn: bool) -> None:
        self.name, self._settings = name, settings
        self.operator_topics = [settings['operator_topic']]
        self.sent, self.received, self.came = 0, 0, False
        self._pair: Optional[Tuple[Any, UInt8Array]] = None     # a sent message, and its view
        self._psnr: List[float] = []
        self._ages: List[float] = []
        self._uncompared, self._unlike = 0, ''
        self._waiting: collections.OrderedDict[Any, Any] = collections.OrderedDict()   # {stamp: message}
        self._lock = threading.Lock()
        self._subscribers = [
            rospy.Subscriber(settings['robot_topic'], Image, self._on_sent, queue_size=20, buff_size=1 << 24),
            rospy.Subscriber(settings['operator_topic'], Image, self._on_received, queue_size=20, buff_size=1 << 24)]
        if drawn and settings['view_topic']:
            self.operator_topics.append(settings['view_topic'])
            self._subscribers.append(
                rospy.Subscriber(settings['view_topic'], Image, self._on_view, queue_size=2, buff_size=1 << 24))

    def _on_sent(self, message: Any) -> None:
        with self._lock:
            self.sent += 1
            self._waiting[message.header.stamp] = message
            while len(self._waiting) > MAX_WAITING:
                self._waiting.popitem(last=False)

    def _on_received(self, message: Any) -> None:
        age = (rospy.Time.now() - message.header.stamp).to_sec()
        with self._lock:
            self.received += 1
            self.came = True
            self._ages.append(age)
            source = self._waiting.get(message.header.stamp)
            self._uncompared += source is None
        if source is None:
            return
        sent, received = image_pixels(source), image_pixels(message)
        alike = (sent.shape, sent.dtype) == (received.shape, received.dtype)
        quality = psnr(sent, received) if alike else math.nan
        with self._lock:
            if alike:
                self._psnr.append(quality)
            else:
                self._uncompared += 1
                self._unlike = '%s is sent, %s comes' % (_kind(source), _kind(message))

    def _on_view(self, view: Any) -> None:
        with self._lock:
            source = self._waiting.get(view.header.stamp)
            if source is not None:
                self._pair = source, image_pixels(view)

    def reset(self) -> None:
        """Start counting anew."""
        with self._lock:
            self.sent = self.received = 0
            self._uncompared, self._unlike = 0, ''
            del self._psnr[:], self._ages[:]

    def compared(self, seconds: float) -> Compared:
        """The result after `seconds` of comparison."""
        with self._lock:
            return Compared(self.name, self._settings, self.sent / seconds, self.received / seconds, self.came,
                            Images(tuple(self._psnr), tuple(self._ages), self._uncompared, self._unlike))

    def picture(self) -> Optional[UInt8Array]:
        """(height, width, 3) uint8 BGR: the newest image as it was sent, beside its view; None: there was none."""
        with self._lock:
            pair = self._pair
        if pair is None:
            return None
        sent, view = pair
        coloured = colouring_of(self._settings)(image_pixels(sent), sent.encoding, sent.header.stamp.to_sec())
        left = titled(coloured, '%s, as sent' % self.name)
        height = min(left.shape[0], view.shape[0])      # the operator's may have another size: scale, region
        return np.hstack([_of_height(image, height) for image in (left, view)])


def _kind(message: Any) -> str:
    return '%d x %d %s' % (message.width, message.height, message.encoding)


def _of_height(image: UInt8Array, height: int) -> UInt8Array:
    if image.shape[0] == height:
        return image
    return np.asarray(cv2.resize(image, (round(image.shape[1] * height / image.shape[0]), height)))


def psnr(sent: Array, received: Array) -> float:
    """Peak signal-to-noise ratio [dB]; infinite if the images are equal.

    The peak is 255 where the pixels of the sent image fit in a byte, otherwise it is the range of its pixels.

    :param sent, received: (height, width) or (height, width, channels) arrays of the same type, in native byte order
    """
    if np.array_equal(sent, received):
        return math.inf
    peak = 255.0 if sent.max() <= 255 else float(sent.max()) - float(sent.min())
    return float(cv2.PSNR(np.ascontiguousarray(sent), np.ascontiguousarray(received), peak))


def stacked(pictures: Sequence[UInt8Array]) -> UInt8Array:
    """(rows, columns, 3) uint8 BGR: all pictures below each other.

    :param pictures: (height, width, 3) uint8 each, at least one
    """
    width = max(picture.shape[1] for picture in pictures)
    return np.vstack([np.pad(picture, ((0, 0), (0, width - picture.shape[1]), (0, 0))) for picture in pictures])
