# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of camera_info: which calibration an image has, and when it is sent.

It is nearly constant, so it is sent before the first image of which it is, several times; before some images after
it; and then once a second. It says from which image on it applies, so it need not come with each of them.
"""
import copy
import math
import threading
from collections import deque
from typing import Any, Collection, Deque, List, Optional, Set

import numpy as np
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from ...msg import CameraInfoSegment
from ...serialised import serialised
from ...udpros.datagram import OVERHEAD
from ...udpros.frame import Frame
from ..segments import room
from .camera_info import part_info
from .source import SourceImage

COPIES = 5
"""Before the first image after a change, or for a new operator: of 3000 times at 20 % loss all are lost once."""

FIRST_IMAGES = 10
"""Then once before each image, until it was sent with this number of images."""

PERIOD = 1.0
"""Then once in this time [s]."""

MEMORY = 32
"""Messages among which that with the stamp of the image is looked for."""


class InfoSender:
    """Sends the calibration of images. `add` is called by one thread, `frames` by another one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received: Deque[CameraInfo] = deque(maxlen=MEMORY)
        self._content = b''             # of what was sent last
        self._since: Any = None         # stamp of the first image of which that is
        self._operators: Set[str] = set()
        self._images = 0                # with which it was sent
        self._sent = 0.0                # when it was last [s]

    def add(self, info: CameraInfo) -> None:
        """Take a message of the camera."""
        with self._lock:
            self._received.append(info)

    def frames(self, source: SourceImage, scale: int, operators: Collection[str], now: float,
               max_datagram_size: int) -> List[Frame]:
        """What is to be sent before an image.

        :param scale: by which it is reduced
        :param operators: names of those that receive it
        :param now: by a steady clock [s]
        :param max_datagram_size: [byte of UDP payload]
        :raises ValueError: the calibration is not of the image, is too long, or no numbers
        """
        header = source.message.header
        received = self._of(header.stamp)
        if received is None:
            return []
        for name in 'D', 'K', 'R', 'P':
            if not all(map(math.isfinite, getattr(received, name))):
                raise ValueError('camera_info has %s: %s' % (name, ', '.join('%g' % one for one in getattr(
                    received, name))))
        info = part_info(received, source.region, (source.height, source.width), scale)
        info.header = Header()
        content = serialised(info)
        if content != self._content or header.stamp < self._since:
            self._content, self._since, self._images = content, header.stamp, 0
        if set(operators) - self._operators:
            self._images = 0
        self._operators = set(operators)
        if self._images >= FIRST_IMAGES and now - self._sent < PERIOD:
            return []
        copies = 1 if self._images else COPIES
        self._images, self._sent = self._images + 1, now
        return [_frame(CameraInfoSegment(Header(0, header.stamp, header.frame_id), self._since, info), copies,
                       max_datagram_size)]

    def _of(self, stamp: Any) -> Optional[CameraInfo]:
        """The calibration with a stamp, or the newest one."""
        with self._lock:
            same = [info for info in self._received if info.header.stamp == stamp] or list(self._received)[-1:]
        return copy.copy(same[-1]) if same else None


def _frame(segment: CameraInfoSegment, copies: int, max_datagram_size: int) -> Frame:
    """A frame of equal messages.

    :raises ValueError: it does not fit in a datagram
    """
    frame_id, model = segment.header.frame_id.encode(), segment.info.distortion_model.encode()
    parameters = len(segment.info.D)
    most = room(CameraInfoSegment, max_datagram_size, frame_id, model) // 8
    if parameters > most:
        raise ValueError('camera_info has %d distortion parameters, must be %d at most' % (parameters, most))
    frame = Frame(CameraInfoSegment, copies, {
        'header.frame_id': len(frame_id), 'info.distortion_model': len(model), 'info.D': parameters})
    frame.rows[:, OVERHEAD:] = np.frombuffer(serialised(segment), np.uint8)
    return frame
