# SPDX-License-Identifier: BSD-3-Clause
"""Messages through the package's streams as they are, but for the network: some of their datagrams come."""
import numpy as np
from sensor_msgs.msg import Image

from benchmarks.codecs import gather, stream
from smokebot_udp.codecs.concealment.fill import BEST
from smokebot_udp.streams import operator_class, robot_class

PATIENT = 3600.0
"""The streams' limit of time to fill a picture must not change what is seen here [s]."""

FILLS = {BEST: 'kriging (this package)', 'nearest': 'nearest received pixel (the deliverable)'}
"""{method: what the figures call it}"""


def robot(kind, **settings):
    """A robot's stream, of which only `frames` is used."""
    return stream(robot_class, kind, **settings)


def images(fill):
    """An operator's image stream of a robot that drives, for `came_of`."""
    return stream(operator_class, 'image', fill=fill, fill_time=PATIENT, integrate='never')


def count(frames):
    """Of datagrams."""
    return sum(map(len, frames))


def records_of(frames, came):
    """The segments that came, an array of records for each frame of which any did.

    :param came: (n,) bool for each datagram, in the order in which they are sent
    """
    parts = np.split(came, np.cumsum([len(frame) for frame in frames])[:-1])
    return [frame.records[part] for frame, part in zip(frames, parts) if part.any()]


def came_of(receiver, frames, came):
    """The message that an operator's stream makes of the segments that came; None where none did."""
    return gather(receiver, records_of(frames, came)) if came.any() else None


def message_of(picture):
    """A sensor_msgs/Image of a (height, width) uint8 picture."""
    message = Image(height=picture.shape[0], width=picture.shape[1], encoding='mono8', step=picture.shape[1],
                    data=picture.tobytes())
    message.header.frame_id = 'camera'
    return message


def picture_of(message):
    """The inverse."""
    return np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)


def passed(channel, count):
    """Which of so many datagrams come through a link_lab.channel.Channel, sent one after the other: (count,) bool."""
    return np.array([bool(channel.fate(0.0, 1)) for _ in range(count)])
