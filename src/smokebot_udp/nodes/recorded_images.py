# SPDX-License-Identifier: BSD-3-Clause
"""Publishes what the black box records of images, see streams/recorded_images.py, and when each of all arrived.

Compressing has a thread of low priority: what is sent and shown comes first.
"""
import os
import threading
import time
from typing import Any, Callable, Dict, Iterable, List, Tuple

import rospy
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from .. import udpros
from ..streams.recorded_images import Backlog, RawRate, Thinning, recorded
from .any_type import class_of, read
from .logging import log_error
from .worker import DeadlineWorker

ARRIVED, IMAGES = '~arrived', '~images'
"""Beginnings of the topics on which the arrival and the image of a topic are recorded."""

NICE = 10
"""Nice value of the thread."""

BUFFER = 1 << 24
"""Size of the subscribers' receive buffers: an image of the largest size [byte]."""


def topics_of(topic: str) -> List[str]:
    """What is recorded of a topic of images; ~ is the black box."""
    return [ARRIVED + topic, IMAGES + topic, IMAGES + topic + '/compressed']


class RecordedImages:
    """Runs it until `close`.

    :param topics: of the images
    :param rate: of the raw images that are recorded of each topic, at most [Hz]; 0: all
    :param warn: f(text), called where images are left out, or are none
    """

    def __init__(self, topics: Iterable[str], rate: float, warn: Callable[[str], object]) -> None:
        self._warn, self._backlog, self._raw = warn, Backlog(), RawRate()
        self._worker: DeadlineWorker[Tuple[str, Any]] = DeadlineWorker(
            'images', lambda now: self._backlog.take(), lambda: None, self._record,
            log_error('an image is not recorded'))
        self._told: Dict[str, int] = {}     # how many were left out, as warned of
        self._publishers: Dict[str, Dict[Any, Any]] = {}
        self._thinning: Dict[str, Thinning] = {}
        self._subscribers: List[Any] = []
        for topic in topics:
            arrived, raw, compressed = topics_of(topic)
            self._thinning[topic] = Thinning(rate)
            self._publishers[topic] = {Header: udpros.Publisher(arrived, Header, queue_size=100),
                                       Image: udpros.Publisher(raw, Image, queue_size=2),
                                       CompressedImage: udpros.Publisher(compressed, CompressedImage, queue_size=20)}
            self._subscribers.append(rospy.Subscriber(topic, rospy.AnyMsg, self._take, topic, queue_size=2,
                                                      buff_size=BUFFER))
        self._worker.start()

    def close(self) -> None:
        """End it; what comes later is not recorded."""
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._worker.close()

    def _take(self, message: Any, topic: str) -> None:
        """A message of a camera; rospy's thread."""
        try:
            image = read(message, class_of(message, (Image, CompressedImage)))
        except ValueError as error:
            self._warn('%s is not recorded: %s' % (topic, error))
            return
        self._publish(topic, image.header)
        # a source without stamps counts by arrival
        stamp = image.header.stamp.to_sec() or rospy.get_time()
        if isinstance(image, Image) and not self._thinning[topic].takes(stamp):
            return
        with self._worker.changing():
            self._backlog.add(topic, image, len(image.data))

    def _record(self, item: Tuple[str, Any]) -> None:
        """Publish what is recorded of an image; the worker's thread."""
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        topic, image = item
        with self._worker.lock:
            left_out, hurries = dict(self._backlog.left_out), self._backlog.hurries
        if left_out != self._told:
            self._told = left_out
            self._warn('the processor is too slow to record the images. Left out until now are %s; '
                       'record_streams:= chooses fewer streams, record_image_rate:= a lower rate' % ', '.join(
                           '%d of %s' % (count, name) for name, count in left_out.items()))
        raw = hurries and self._raw.take(len(image.data), time.monotonic())
        made = image if raw else recorded(image)
        self._publish(topic, made)

    def _publish(self, topic: str, message: Any) -> None:
        """Publish what is recorded of a topic; nothing while the node ends, as rospy closes its topics then."""
        try:
            self._publishers[topic][type(message)].publish(message)
        except (rospy.ROSException, ValueError):
            if not rospy.is_shutdown():
                raise
