# SPDX-License-Identifier: BSD-3-Clause
"""Both ends of an image stream, without ROS between them."""
from types import SimpleNamespace

import numpy as np
from genpy import Time
from sensor_msgs.msg import Image

from smokebot_udp.mission.parameters import check
from smokebot_udp.streams.base import Link
from smokebot_udp.streams.image import ImageReceiver, ImageSender

STANDS = SimpleNamespace(stands=lambda: True, pictures=lambda changed: None)


def picture(seconds, pixels):
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding='mono16', step=pixels.strides[0],
                    data=pixels.tobytes())
    message.header.stamp = Time(seconds, 0)
    return message


def sender():
    return ImageSender('thermal', check({'robot_topic': '/in'}, ImageSender.PARAMETERS), Link(1472))


def noise(seed):
    return np.random.RandomState(seed).randint(0, 65536, (120, 160)).astype(np.uint16)


def test_a_picture_that_is_leaving_is_not_touched_by_the_next_one():
    stream = sender()
    leaving = stream.frames(picture(1, noise(1)))
    before = [frame.rows.copy() for frame in leaving]
    stream.frames(picture(2, noise(2)))
    assert all((frame.rows == rows).all() for frame, rows in zip(leaving, before))


def test_a_whole_picture_is_remembered_for_the_next_one():
    pixels, stream = noise(0), sender()
    receiver = ImageReceiver('thermal', check({'operator_topic': '/out'}, ImageReceiver.PARAMETERS),
                             Link(1472, motion=STANDS))
    for seconds, step in ((1, 1), (2, 2)):      # of the second one half comes
        for frame in stream.frames(picture(seconds, pixels)):
            receiver.take(frame.records, np.arange(len(frame)) % step == 0)
        dated = receiver._finished.pop() if receiver._finished else receiver._sequence.poll(float('inf'))
        message = receiver.message(dated.picture.head, dated.picture)
        receiver.shown(dated.picture.head, dated.picture, message)
        assert dated.picture.have.all() == (step == 1)
        assert message.data == pixels.tobytes()
